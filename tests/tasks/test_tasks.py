"""All built-in tasks against dm_control's own: models, rewards, motion and initial states."""

import contextlib
import dataclasses
import functools
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import dm_control
import mujoco
import numpy as np
import pytest
from mujoco.batch import MODEL_FIELDS, Batch

from simtune.errors import UnknownName
from simtune.experiment.rollout import PolicyWorlds, _charge_failures
from simtune.parameters import ModelWriter
from simtune.simulation import scale_actions
from simtune.tasks import TASKS, load_task

VEL = mujoco.mjtStage.mjSTAGE_VEL.value
POS = mujoco.mjtStage.mjSTAGE_POS.value
_MODELS = Path(dm_control.__file__).parent / "suite"
# {name: the suite's task}, which a built-in task's function is named like
SUITE_TASKS = {
    name: make.__name__ for name, make in TASKS.items() if (_MODELS / f"{name}.xml").is_file()
}
BUILT_IN = pytest.mark.parametrize("name", list(SUITE_TASKS))

# Indices into the suite's models, where the paper has it the paper's, which our names must hit.
OBJECT_IDS = {
    ("ball_in_cup", "ball_mass"): [2],
    ("ball_in_cup", "cup_r"): range(1, 6),
    ("ball_in_cup", "ball_r"): [6],
    ("ball_in_cup", "ground_r"): [0],
    ("walker", "mass"): range(1, 8),
    ("walker", "body_r"): range(1, 8),
    ("walker", "ground_r"): [0],
    ("cheetah", "mass"): range(1, 8),
    ("cheetah", "body_r"): range(1, 9),
    ("cheetah", "ground_r"): [0],
    ("finger", "spinner_mass"): [3],
    ("finger", "proximal_damping"): [0],
    ("finger", "finger_r"): range(2, 4),
    ("finger", "spinner_r"): range(5, 7),
    ("finger", "ground_r"): [0],
    ("cartpole", "pole_mass"): [2],
    ("cartpole", "actuator_gain"): [0],
    ("cartpole", "body_r"): range(3, 5),
    ("cartpole", "ground_r"): [0],
}
KIND_OF = {"body": "body", "geom": "geom", "dof": "joint", "actuator": "actuator"}


@functools.cache
def task_of(name):
    return load_task(name)


@functools.cache
def model_of(name):
    return task_of(name).load_model()


@functools.cache
def suite_env(name):
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")  # no display: dm_control looks for one when imported
        with contextlib.chdir(folder):  # MuJoCo logs the cheetah's deprecated attribute here
            from dm_control import suite

            return suite.load(name, SUITE_TASKS[name], task_kwargs={"random": 0})


def state_of(env):
    """The whole state of a dm_control environment, as a batch's rows have it."""
    return env.physics.get_state(mujoco.mjtState.mjSTATE_INTEGRATION.value)


def substeps(task, model):
    return round(task.control_timestep_s / model.opt.timestep)


def random_actions(env, num_steps, seed=0):
    spec = env.action_spec()
    rng = np.random.default_rng(seed)
    actions = rng.uniform(spec.minimum, spec.maximum, (num_steps, *spec.shape))
    return np.repeat(actions[::4], 4, axis=0)[:num_steps]  # held, so that something happens


@pytest.mark.parametrize("name", TASKS)
def test_a_task_has_the_name_that_finds_it(name):
    assert task_of(name).name == name


def test_the_suites_tasks_are_found():
    assert {"cartpole": "balance", "finger": "spin"}.items() <= SUITE_TASKS.items()


def test_unknown_task():
    with pytest.raises(UnknownName, match=r"no task 'walkr' in simtune .*did you mean 'walker'\?"):
        load_task("walkr")


def test_import_brings_neither_opengl_nor_torch():
    code = (
        "import sys; from simtune.tasks import load_task; load_task('walker').load_model();"
        "assert not {'dm_control.suite', 'OpenGL', 'torch'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@BUILT_IN
def test_model_is_the_suites(name):
    env = suite_env(name)
    env.reset()  # finger's changes its model there
    ours, theirs = model_of(name), env.physics.model.ptr
    for field in sorted(f for f in MODEL_FIELDS if not f.startswith("opt.")):
        a, b = getattr(ours, field), getattr(theirs, field)
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12, err_msg=field)
    for field in ("timestep", "integrator", "iterations", "disableflags", "cone"):
        assert getattr(ours.opt, field) == getattr(theirs.opt, field), field
    assert ours.stat.meaninertia == pytest.approx(theirs.stat.meaninertia)


@BUILT_IN
def test_time_and_camera(name):
    task, env = task_of(name), suite_env(name)
    assert task.control_timestep_s == pytest.approx(env.control_timestep())
    assert task.cameras[0].camera == env.physics.model.id2name(0, "camera")
    assert task.episode_steps == 200
    assert task.step_s == task.control_timestep_s * task.action_repeat


def rewarding_states(name, env, rng):
    """Put the environment into a state that random actions seldom reach, but rewards look at."""
    with env.physics.reset_context():
        qpos, qvel = env.physics.data.qpos, env.physics.data.qvel
        if name == "ball_in_cup":
            qpos[:2] = rng.uniform(-0.1, 0.1, 2)
            at_cup = qpos[:2] + np.array([0, 0.35])
            qpos[2:] = at_cup + rng.uniform(-0.04, 0.04, 2)
        elif name == "walker":
            qpos[:] = rng.uniform(-0.2, 0.2, len(qpos))
            qvel[1] = rng.uniform(-1, 3)
        elif name == "cheetah":
            qvel[0] = rng.uniform(-2, 15)
        elif name == "finger":
            qvel[2] = rng.uniform(-30, 5)
        else:
            qpos[:] = rng.uniform(-3, 3, len(qpos))
            qvel[:] = rng.uniform(-10, 10, len(qvel))
    env.physics.set_control(rng.uniform(-1.5, 1.5, env.physics.model.nu))


@BUILT_IN
def test_reward_is_the_suites_anywhere(name):
    task, env, rng = task_of(name), suite_env(name), np.random.default_rng(3)
    states, rewards = [], []
    for _ in range(200):
        rewarding_states(name, env, rng)
        states.append(state_of(env))
        rewards.append(env.task.get_reward(env.physics))
    batch = Batch(model_of(name), len(states), 2)
    batch.state[:] = states
    batch.forward(stage=VEL)
    got = task.reward(batch)
    assert got.shape == (200,)
    assert np.ptp(rewards) > 0.1, f"add states of {name} to rewarding_states in test_tasks.py"
    np.testing.assert_allclose(got, rewards, rtol=0, atol=1e-9)


@BUILT_IN
def test_reward_and_motion_are_the_suites(name):
    """Side by side from the same state, under the same actions, never synchronised."""
    task, env, model = task_of(name), suite_env(name), model_of(name)
    batch = Batch(model, 2, 1)
    env.task.random.seed(1)
    env.reset()
    batch.state[:] = state_of(env)
    for action in random_actions(env, 100):
        theirs = env.step(action)
        batch.ctrl[:] = action
        batch.step(nstep=substeps(task, model), stage=VEL)
        for world in range(2):
            np.testing.assert_allclose(batch.qpos[world], env.physics.data.qpos, atol=1e-7)
            np.testing.assert_allclose(batch.qvel[world], env.physics.data.qvel, atol=1e-6)
        np.testing.assert_allclose(task.reward(batch), theirs.reward, atol=1e-7)


@BUILT_IN
def test_reward_along_the_suites_trajectories(name):
    """At each control step's state, taken over from dm_control."""
    task, env, model = task_of(name), suite_env(name), model_of(name)
    batch = Batch(model, 100, 1)
    states, rewards = [], []
    env.task.random.seed(2)
    env.reset()
    for action in random_actions(env, batch.nsim, seed=1):
        rewards.append(env.step(action).reward)
        states.append(state_of(env))
    batch.state[:] = states
    batch.forward(stage=VEL)
    np.testing.assert_allclose(task.reward(batch), rewards, rtol=0, atol=1e-9)


@BUILT_IN
def test_reward_needs_no_initialize(name):
    """A field that is bound late is zero until the next call: the reward must not be."""
    task, model = task_of(name), model_of(name)
    first, second = Batch(model, 3, 1), Batch(model, 3, 1)
    for batch in (first, second):
        batch.qpos[:] = np.linspace(0, 0.1, 3)[:, None]
    task.initialize(first, np.random.default_rng(0))  # binds whatever it binds
    first.state[:] = second.state
    first.forward(stage=VEL)
    second.forward(stage=VEL)
    np.testing.assert_array_equal(task.reward(second), task.reward(first))


@BUILT_IN
def test_initial_states_follow_the_suites_distribution(name):
    task, env, model = task_of(name), suite_env(name), model_of(name)
    n = 120 if name == "cheetah" else 300
    env.task.random.seed(0)
    theirs = []
    for _ in range(n):
        env.reset()
        theirs.append(np.concatenate([env.physics.data.qpos, env.physics.data.qvel]))
    theirs = np.array(theirs)
    batch = Batch(model, 2 * n, 2)
    task.initialize(batch, np.random.default_rng(0))
    ours = np.concatenate([batch.qpos, batch.qvel], axis=1)
    std = theirs.std(0)
    error = 5 * std * np.sqrt(1 / n + 1 / len(ours)) + 1e-12
    assert (np.abs(ours.mean(0) - theirs.mean(0)) < error).all()
    if name == "cheetah":  # heavy tails: a few fall on their head, compare the middle
        for q in (0.1, 0.25, 0.5, 0.75, 0.9):
            assert (np.abs(np.quantile(ours, q, 0) - np.quantile(theirs, q, 0)) < 0.5 * std).all()
    else:
        np.testing.assert_allclose(ours.std(0), std, rtol=0.15, atol=1e-12)
        spread = np.ptp(theirs, axis=0)
        assert (np.abs(ours.min(0) - theirs.min(0)) <= 0.25 * spread).all()
        assert (np.abs(ours.max(0) - theirs.max(0)) <= 0.25 * spread).all()


@BUILT_IN
def test_initial_states(name):
    task, model = task_of(name), model_of(name)
    batch = Batch(model, 40, 2)
    batch.qvel[:], batch.ctrl[:], batch.time[:] = 1, 1, 7  # of an episode before
    task.initialize(batch, np.random.default_rng(0))
    limited = model.jnt_limited == 1
    low, high = model.jnt_range[limited].T
    give = 0.2 if name == "cheetah" else 0  # soft limits: it has moved already
    assert (batch.qpos[:, limited] >= low - give).all()
    assert (batch.qpos[:, limited] <= high + give).all()
    assert (batch.time == 0).all()
    assert (batch.ctrl == 0).all()
    assert np.isfinite(batch.state).all()
    assert (batch.qpos.std(0) > 0).any()
    if name in ("ball_in_cup", "finger"):
        ncon = batch.bind("ncon")
        batch.forward(stage=POS)
        assert (ncon == 0).all()

    first = batch.state.copy()
    task.initialize(batch, np.random.default_rng(0))
    np.testing.assert_array_equal(batch.state, first)
    task.initialize(batch, np.random.default_rng(1))
    assert not np.array_equal(batch.qpos, first[:, 1 : 1 + model.nq])


@BUILT_IN
def test_objects_are_the_papers(name):
    task, model = task_of(name), model_of(name)
    for parameter in task.parameters:
        first = parameter.name.removesuffix("_g").removesuffix("_b")
        ids = OBJECT_IDS.get((name, parameter.name)) or OBJECT_IDS.get((name, first + "_r"))
        missing = f"add {name}'s {parameter.name} to OBJECT_IDS in tests/tasks/test_tasks.py"
        assert ids is not None, missing
        kind = KIND_OF[parameter.field.split("_")[0]]
        assert sorted(getattr(model, kind)(o).id for o in parameter.objects) == list(ids)


@BUILT_IN
def test_every_parameter_changes_the_model(name):
    task = task_of(name)
    nominal = model_with(task, task.parameters.nominal)
    for i, parameter in enumerate(task.parameters):
        for end in (parameter.low, parameter.high):
            if end == parameter.nominal:
                continue
            values = task.parameters.nominal.copy()
            values[i] = end
            before = getattr(nominal, parameter.field)
            after = getattr(model_with(task, values), parameter.field)
            changed = np.argwhere((before != after).reshape(len(before), -1).any(1))
            assert len(changed) == len(parameter.objects), parameter.name


@BUILT_IN
def test_nominal_is_the_models_own(name):
    """Bit for bit, but for colours that a material gave: those are the geom's own now."""
    task, model = task_of(name), model_of(name)
    written = model_with(task, task.parameters.nominal)
    for field in sorted(f for f in MODEL_FIELDS if not f.startswith("opt.")):
        if field != "geom_rgba":
            a, b = getattr(written, field), getattr(model, field)
            np.testing.assert_array_equal(a, b, err_msg=field)
    np.testing.assert_array_equal(drawn_rgba(written), drawn_rgba(model))


@BUILT_IN
def test_bounds(name):
    for p in task_of(name).parameters:
        if p.is_colour:
            assert (p.low, p.high, p.scale) == (0, 1, "linear")
        else:
            assert (p.low, p.high, p.scale) == (p.nominal / 10, p.nominal * 10, "log")


@BUILT_IN
def test_the_tuned_model_can_be_exported(name):
    """The spec takes the written values back, and its XML compiles to them."""
    task = task_of(name)
    spec = task.load_spec()
    model = spec.compile()
    values = task.parameters.from_unit(np.full(len(task.parameters), 0.7))
    ModelWriter(task.parameters, model).write(model, values)
    spec.copy_back(model)
    again = mujoco.MjModel.from_xml_string(spec.to_xml())
    for field in ("body_mass", "body_inertia", "dof_damping", "actuator_gainprm", "geom_rgba"):
        a, b = getattr(again, field), getattr(model, field)
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6, err_msg=field)


def model_with(task, values):
    model = mujoco.MjModel.__copy__(model_of(task.name))
    ModelWriter(task.parameters, model_of(task.name)).write(model, values)
    return model


def drawn_rgba(model):
    """What a renderer draws: the material's colour where the geom has MuJoCo's default grey."""
    rgba = model.geom_rgba.copy()
    grey = (rgba == np.float32([0.5, 0.5, 0.5, 1])).all(1) & (model.geom_matid >= 0)
    rgba[grey] = model.mat_rgba[model.geom_matid[grey]]
    return rgba


@pytest.mark.parametrize("name", [n for n in TASKS if load_task(n).symmetric_hinges])
def test_what_is_said_to_be_symmetric_looks_and_moves_alike(name):
    task = load_task(name)
    simulator = task.simulator(image_size=48)
    environment = PolicyWorlds(task, simulator, num_stacked=1)
    rng = np.random.default_rng(0)
    worlds = np.tile(task.parameters.nominal, (8, 1))
    actions = rng.uniform(-1, 1, (8, 30, simulator.num_actions))
    first = simulator.roll_out(worlds, actions, rng)
    for hinge, order in task.symmetric_hinges.items():
        starts = first.states[:, 0].copy()
        starts[:, 1 + simulator.model.joint(hinge).qposadr[0]] += 2 * np.pi / order
        other = simulator.roll_out(worlds, actions, rng, starts=starts)
        np.testing.assert_array_equal(simulator.film(first), simulator.film(other))
        seen, seen_other = (environment.observe(r.states) for r in (first, other))
        np.testing.assert_allclose(seen, seen_other, atol=1e-4)
        turned = first.states[:, 0].copy()
        turned[:, 1 + simulator.model.joint(hinge).qposadr[0]] += 0.7 * 2 * np.pi / order
        assert np.abs(environment.observe(turned) - seen[:, 0]).max() > 0.1


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "hz"), [("cartpole", 20.0), ("cheetah", 15.0), ("finger", 30.0)])
def test_a_policy_acts_as_long_as_the_search_simulates_at_any_rate(name, hz):
    """Rewards are read `action_repeat` times in a step, however its physics steps divide."""
    task = dataclasses.replace(load_task(name), episode_steps=20)
    simulator = task.simulator(image_size=48, step_s=1 / hz)
    environment = PolicyWorlds(task, simulator, num_stacked=1)
    worlds = np.tile(task.parameters.nominal, (2, 1))
    drawn = np.random.default_rng(0).uniform(-1, 1, (20, 2, simulator.num_actions))
    acts = iter(drawn)
    rng = np.random.default_rng(1)
    played = environment.play(lambda seen: next(acts), worlds, rng, film=False)
    actions = scale_actions(simulator.action_mapping, drawn.swapaxes(0, 1).astype(np.float32))
    straight = simulator.roll_out(
        worlds, actions, np.random.default_rng(0), starts=played.full_states[:, 0]
    )
    np.testing.assert_allclose(played.full_states[:, -1], straight.states[:, -1], atol=1e-5)
    assert played.full_states[0, -1, 0] == pytest.approx(
        20 / hz, rel=0.05
    )  # a full state begins with time


def test_a_world_that_is_dead_earns_nothing_and_no_policy_may_lose_its_mind():
    task = dataclasses.replace(load_task("cheetah"), episode_steps=6)
    simulator = task.simulator(image_size=48)
    environment = PolicyWorlds(task, simulator, num_stacked=1)
    worlds = np.tile(task.parameters.nominal, (2, 1))
    rng = np.random.default_rng(0)

    class Diverging:
        """In the first world, after three steps."""

        def __init__(self):
            self.step = simulator.play

        def __call__(self, *args, **kwargs):
            played = self.step(*args, **kwargs)
            return dataclasses.replace(played, lengths=np.array([3, 6]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulator, "play", Diverging())
        episodes = environment.play(lambda seen: np.ones((2, 6)), worlds, rng, film=False)
    assert (episodes.rewards[0, 3:] == 0).all()
    assert (episodes.rewards[1, 3:] > 0).any()
    costs = np.array([[-1.0, -2.0, -9.0, -9.0], [-3.0, -1.0, -1.0, -1.0]])
    _charge_failures(costs, np.arange(4) >= np.array([[2], [4]]), lowest=-3.0)
    # To the end, as badly as the worst step; to diverge would pay, else.
    np.testing.assert_array_equal(costs, [[-1, -2 - 2 * 3, 0, 0], [-3, -1, -1, -1]])
    assert (episodes.terminated == [True, False]).all()  # time is up for the other: no end
    # A lone world is charged by what others earned before
    environment.load({"lowest_reward": -2.0})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulator, "play", Diverging())
        charged = environment.play(lambda seen: np.ones((2, 6)), worlds, rng, film=False)
    assert charged.rewards[0, 2] == pytest.approx(episodes.rewards[0, 2] - 3 * 2.0, abs=1)
    environment.load({"lowest_reward": 0.0})
    environment._reward = lambda batch: np.full(2, np.inf)
    with pytest.raises(RuntimeError, match="the reward of cheetah is no finite number"):
        environment.play(lambda seen: np.ones((2, 6)), worlds, rng, film=False)
    with pytest.raises(RuntimeError, match="its training diverged"):
        environment.play(lambda seen: np.full((2, 6), np.nan), worlds, rng, film=False)


def test_a_world_that_dies_ends_alone(tmp_path, monkeypatch):
    """Whoever acts by the state is told numbers, and MuJoCo writes no log of it."""
    monkeypatch.chdir(tmp_path)
    task = dataclasses.replace(load_task("walker"), episode_steps=6)

    def begin(batch, rng):
        task.initialize(batch, rng)
        batch.qvel[1] = 2e4

    simulator = dataclasses.replace(task, initialize=begin).simulator(image_size=48)
    environment = PolicyWorlds(task, simulator, num_stacked=2)
    told = []

    def act(seen):
        told.append(seen.state)
        return np.clip(seen.state[:, : simulator.num_actions], -1, 1)

    worlds = np.tile(task.parameters.nominal, (3, 1))
    played = environment.play(act, worlds, np.random.default_rng(0))
    assert played.lengths[1] < 6
    assert (played.lengths[[0, 2]] == 6).all()
    assert (played.terminated == [False, True, False]).all()
    assert np.isfinite(told).all()
    assert np.isfinite(played.actions).all()
    assert not list(tmp_path.iterdir())
