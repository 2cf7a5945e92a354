"""Worlds step exactly as MuJoCo does, and leave those out whose physics diverges."""

import warnings
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from late_actuators import delay

import simtune.simulation
from simtune.parameters import ModelWriter, ParameterSpace
from simtune.simulation import DirectActions, StateSpace, prepare_spec, random_actions
from simtune.simulation.worlds import Worlds
from simtune.tasks import Task, load_task

STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture(scope="module")
def walker() -> Task:
    return load_task("walker")


@pytest.fixture(scope="module")
def cartpole() -> Task:
    return load_task("cartpole")


def some_parameters(task: Task, num_worlds: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return task.parameters.from_unit(rng.uniform(0.3, 0.7, (num_worlds, len(task.parameters))))


def plain_loop(task: Task, parameters, start, actions, num_substeps) -> np.ndarray:
    """(T + 1, S) states of one world, by nothing but mj_step."""
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, parameters)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start, STATE)
    states = [start.copy()]
    for action in actions:
        data.ctrl[:] = action
        mujoco.mj_step(model, data, num_substeps)
        states.append(np.empty_like(start))
        mujoco.mj_getState(model, data, states[-1], STATE)
    return np.array(states)


def test_rollouts_are_those_of_a_plain_loop_to_the_last_bit(walker):
    simulator = walker.simulator(image_size=16)  # few pixels: they are not looked at
    rng = np.random.default_rng(1)
    actions = random_actions(3, 12, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(some_parameters(walker, 3), actions, rng)
    for parameters, states, played in zip(
        rollouts.parameters, rollouts.states, rollouts.actions, strict=True
    ):
        expected = plain_loop(walker, parameters, states[0], played, simulator.num_substeps)
        np.testing.assert_array_equal(states, expected)


def test_rollouts_have_the_shapes_that_renderers_and_learners_expect(cartpole):
    simulator = cartpole.simulator(image_size=16)
    rng = np.random.default_rng(0)
    actions = random_actions(4, 5, simulator.action_mapping, rng)
    parameters = some_parameters(cartpole, 4)
    rollouts = simulator.roll_out(parameters, actions, rng)
    state_size = mujoco.mj_stateSize(simulator.model, STATE)
    assert len(rollouts) == 4
    assert rollouts.states.shape == (4, 6, state_size)
    np.testing.assert_array_equal(rollouts.parameters, parameters)
    np.testing.assert_array_equal(rollouts.actions, actions)
    assert simulator.num_steps == 20
    frames = simulator.film(rollouts)
    assert frames.shape == (4, 6, 16, 16, 3)
    assert frames.dtype == np.uint8


@pytest.mark.parametrize("speed", [np.nan, np.inf, 1e15])
def test_a_diverged_world_stops_and_the_others_go_on_unchanged(
    cartpole, speed, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)  # where MuJoCo would write its log
    parameters = some_parameters(cartpole, 3)
    disturbed, undisturbed = (Worlds(cartpole.load_model(), cartpole.parameters, 3) for _ in "ab")
    for worlds in (disturbed, undisturbed):
        worlds.reset(parameters, cartpole.initialize, np.random.default_rng(0))
    disturbed.batch.qvel[1] = speed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for worlds in (disturbed, undisturbed):
            for _ in range(10):
                worlds.step(np.ones((3, 1)), 8)
    np.testing.assert_array_equal(disturbed.alive, [True, False, True])
    assert undisturbed.alive.all()
    np.testing.assert_array_equal(disturbed.state[[0, 2]], undisturbed.state[[0, 2]])
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_a_diverged_world_is_not_put_back_to_its_start_in_silence(cartpole):
    worlds = Worlds(cartpole.load_model(), cartpole.parameters, 2)
    worlds.reset(some_parameters(cartpole, 2), cartpole.initialize, np.random.default_rng(0))
    worlds.batch.qvel[0] = np.nan
    worlds.step(np.ones((2, 1)), 8)
    assert not np.isfinite(worlds.state[0]).all()


def test_a_reset_brings_a_diverged_world_back(cartpole):
    parameters = some_parameters(cartpole, 2)
    fresh, used = (Worlds(cartpole.load_model(), cartpole.parameters, 2) for _ in "ab")
    used.reset(parameters, cartpole.initialize, np.random.default_rng(3))
    used.batch.qvel[0] = np.nan
    used.step(np.ones((2, 1)), 8)
    for worlds in (fresh, used):
        worlds.reset(parameters, cartpole.initialize, np.random.default_rng(0))
        assert worlds.alive.all()
        worlds.step(np.ones((2, 1)), 8)
    np.testing.assert_array_equal(used.state, fresh.state)


def test_diverged_episodes_are_left_out_of_rollouts(cartpole):
    def initialize(batch, rng):
        cartpole.initialize(batch, rng)
        batch.qvel[2] = np.nan

    simulator = replace(cartpole, initialize=initialize).simulator(image_size=16)
    rng = np.random.default_rng(0)
    parameters = some_parameters(cartpole, 4)
    actions = random_actions(4, 5, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(parameters, actions, rng)
    assert len(rollouts) == 3
    assert np.isfinite(rollouts.states).all()
    np.testing.assert_array_equal(rollouts.parameters, parameters[[0, 1, 3]])
    np.testing.assert_array_equal(rollouts.actions, actions[[0, 1, 3]])
    assert simulator.num_diverged == 1


def test_random_actions_stay_in_the_controls_ranges_and_are_held(walker):
    model = walker.load_model()
    model.actuator_ctrlrange[:] = [[-0.5, 2]] * model.nu
    model.actuator_ctrllimited[1] = False
    actions = random_actions(50, 30, DirectActions(model), np.random.default_rng(0), hold=4)
    assert actions.shape == (50, 30, model.nu)
    np.testing.assert_array_equal(actions[:, :28].reshape(50, 7, 4, -1).std(axis=2), 0)
    assert (actions[:, 3] != actions[:, 4]).all()
    low, high = actions.min(axis=(0, 1)), actions.max(axis=(0, 1))
    assert low[0] == pytest.approx(-0.5, abs=0.05)
    assert high[0] == pytest.approx(2, abs=0.05)
    assert low[1] == pytest.approx(-1, abs=0.05)  # without limits: [-1, 1]
    assert high[1] == pytest.approx(1, abs=0.05)


def test_a_step_lasts_as_long_as_the_recording_says(cartpole):
    """At 30 frames/s no whole number of the model's .01 s makes a step: the timestep gives way."""
    simulator = cartpole.simulator(image_size=16, step_s=1 / 30)
    rollouts = simulator.roll_out(
        some_parameters(cartpole, 1), np.zeros((1, 30, 1)), np.random.default_rng(0)
    )
    time_s = rollouts.states[0, :, 0]
    np.testing.assert_allclose(time_s[-1] - time_s[0], 1.0, rtol=1e-9)
    assert cartpole.simulator(image_size=16).model.opt.timestep == 0.01


def test_positions_and_velocities_of_full_states_are_read_and_written(walker):
    model, rng = walker.load_model(), np.random.default_rng(0)
    data, space = mujoco.MjData(model), StateSpace(model)
    data.time, data.qpos[:], data.qvel[:] = 3.0, rng.normal(size=9), rng.normal(size=9)
    data.ctrl[:] = 0.5
    full_state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, full_state, STATE)
    moving = space.positions_and_velocities(full_state)
    np.testing.assert_array_equal(moving, [*data.qpos, *data.qvel])
    states = rng.normal(size=(4, 2, 18))
    changed = space.with_positions_and_velocities(np.stack([full_state] * 2), states)
    np.testing.assert_array_equal(space.positions_and_velocities(changed), states)
    others = np.delete(changed, slice(1, 19), axis=-1)
    np.testing.assert_array_equal(others, np.tile(np.delete(full_state, slice(1, 19)), (4, 2, 1)))
    np.testing.assert_array_equal(moving, [*data.qpos, *data.qvel])  # the original is as it was


# --- controls that come late ----------------------------------------------------------------


def delayed(task: Task, high_s: float) -> Task:
    """The task with the delay of all its actuators as its last parameter."""
    model = task.load_model()
    names = tuple(model.actuator(i).name for i in range(model.nu))
    return replace(
        task, parameters=ParameterSpace([*task.parameters, delay("late", names, high_s)])
    )


def late_by_hand(controls: np.ndarray, delay_s: float, timestep_s: float) -> np.ndarray:
    """(T, nu) what comes of controls of single physics steps: the mean of each late step."""
    delay_steps = max(delay_s / timestep_s, float(delay_s > 0))  # less than one step acts as one
    whole, part = int(delay_steps), delay_steps % 1
    past = np.pad(controls, ((whole + 1, 0), (0, 0)))  # none before the start
    later, earlier = past[1 : len(controls) + 1], past[: len(controls)]
    return (1 - part) * later + part * earlier


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["walker", "ball_in_cup"])
def test_every_world_follows_its_controls_as_late_as_its_parameter_says(name):
    """Whole steps and parts of them, none, less than one, and the longest there is."""
    task = delayed(load_task(name), 0.06)
    simulator = task.simulator(image_size=16)
    timestep_s = simulator.model.opt.timestep
    delays_s = np.array([0, 0.4 * timestep_s, timestep_s, 0.02, 3.3 * timestep_s, 0.06])
    parameters = some_parameters(task, len(delays_s))
    parameters[:, -1] = delays_s
    rng = np.random.default_rng(0)
    actions = random_actions(len(delays_s), 15, simulator.action_mapping, rng, hold=1)
    rollouts = simulator.roll_out(parameters, actions, rng)
    assert len(rollouts) == len(delays_s)

    plain = load_task(name).load_model()  # knows no delays
    writer = ModelWriter(load_task(name).parameters, plain)
    moving = slice(0, 1 + plain.nq + plain.nv)  # time, qpos, qvel
    for i, delay_s in enumerate(delays_s):
        writer.write(plain, parameters[i, :-1])
        data = mujoco.MjData(plain)
        state = rollouts.states[i, 0]
        data.qpos[:], data.qvel[:] = state[1 : 1 + plain.nq], state[1 + plain.nq : moving.stop]
        controls = np.repeat(actions[i], simulator.num_substeps, axis=0)
        for t, late in enumerate(late_by_hand(controls, delay_s, timestep_s)):
            data.ctrl[:] = late
            mujoco.mj_step(plain, data)
            if (t + 1) % simulator.num_substeps == 0:
                got = rollouts.states[i, (t + 1) // simulator.num_substeps, moving]
                expected = [data.time, *data.qpos, *data.qvel]
                np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize(("integrator", "early_steps"), [("Euler", 0.0), ("RK4", 0.5)])
def test_delays_under_runge_kutta_end_half_a_step_early(integrator, early_steps):
    """It looks half a step and a step ahead. Here: by when a constant push has made its speed."""
    xml = f"""<mujoco><option timestep="0.01" gravity="0 0 0" integrator="{integrator}"/>
      <worldbody><body><joint name="x" type="slide"/><geom size="1" mass="1"/></body></worldbody>
      <actuator><motor name="push" joint="x"/></actuator></mujoco>"""
    spec = mujoco.MjSpec.from_string(xml)
    space = ParameterSpace([delay("late", ("push",), 0.1)])
    prepare_spec(spec, space, step_s=0.01)
    worlds = Worlds(spec.compile(), space, 3)
    delays_s = np.array([0.02, 0.033, 0.1])
    worlds.reset(delays_s[:, None], lambda batch, rng: None, np.random.default_rng(0))
    for _ in range(30):
        worlds.step(np.ones((3, 1)), 1)
    begun_s = 0.3 - worlds.batch.qvel[:, 0]
    np.testing.assert_allclose(begun_s, delays_s - early_steps * 0.01, atol=1e-9)


def test_a_new_episode_forgets_the_controls_of_the_last(cartpole):
    task = delayed(cartpole, 0.1)
    simulator = task.simulator(image_size=16)
    parameters = some_parameters(task, 2)
    parameters[:, -1] = 0.1
    actions = np.ones((2, 8, 1))
    first, second = (
        simulator.roll_out(parameters, actions, np.random.default_rng(0)).states for _ in "ab"
    )
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("step_s", [1 / 30, 0.0085, 0.05])
def test_the_longest_delay_is_remembered_at_every_timestep(cartpole, step_s):
    task = delayed(cartpole, 0.1)
    simulator = task.simulator(image_size=16, step_s=step_s)
    num_samples, interpolation = simulator.model.actuator_history[0]
    assert num_samples * simulator.model.opt.timestep * (1 + 1e-6) >= 0.1
    # An exported model is played with its own timestep
    shorter_s = min(simulator.model.opt.timestep, task.load_model(step_s).opt.timestep)
    assert num_samples * shorter_s * (1 + 1e-6) >= 0.1
    assert (num_samples - 1) * shorter_s < 0.1
    assert interpolation == 1


def test_only_delayed_actuators_remember(walker):
    assert walker.load_model().nhistory == 0
    late = delay("late", ("left_hip",), 0.05)
    task = replace(walker, parameters=ParameterSpace([*walker.parameters, late]))
    model = task.load_model()
    hip = model.actuator("left_hip").id
    assert model.actuator_history[hip, 0] == 20
    assert model.actuator_history[:, 0].sum() == 20


def test_the_simulation_package_imports_nothing_of_commands():
    folder = Path(simtune.simulation.__file__).parent
    for file in folder.glob("*.py"):
        assert "simtune.config" not in file.read_text(encoding="utf-8"), file.name
