"""The reality gap: pictures and delays that the simulator does not have, and still no way in."""

import dataclasses
import itertools
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from late_actuators import delay
from servo_arm import write_arm
from short_training import by_few_windows, config_of

from simtune.agents import Observation
from simtune.algorithm import train
from simtune.cameras.footage import Footage
from simtune.config import EvaluateConfig, RealConfig, TuneConfig
from simtune.errors import InputError
from simtune.evaluation.evaluate import evaluate
from simtune.experiment.experiment import build_experiment
from simtune.experiment.rollout import PolicyWorlds
from simtune.experiment.training_experiment import TrainingExperiment, build_training
from simtune.experiment.training_parts import _max_delay_steps
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.real.choose import choose_real
from simtune.real.gap import RealityGap
from simtune.real.pseudo import PseudoReal
from simtune.run.files import read_jsonl
from simtune.simulation import Simulator, acting_late
from simtune.simulation.rendering import opengl
from simtune.simulation.rendering.renderer import make_renderer
from simtune.tasks import load_task
from simtune.trajectory import Trajectory, delayed
from simtune.vision.image_noise import ImageNoise
from simtune.vision.noisy_cameras import NoisyCameras
from simtune.vision.smoothing import with_smooth_chroma

STEPS = 12
SIZE = 32
TASK = dataclasses.replace(load_task("cartpole"), episode_steps=STEPS)
SPACE = TASK.parameters
STILL = RealityGap(SIZE, brightness=1.0)


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    """The ray caster stands in for OpenGL: the gap takes pictures of any size."""
    return TASK.simulator(image_size=2 * SIZE)


def collect(simulator: Simulator, gap: RealityGap | None, seed: int = 0) -> list[Trajectory]:
    real = PseudoReal(simulator, SPACE.nominal, episode_steps=STEPS, seed=seed, gap=gap)
    return real.collect(2)


def drawn_by_opengl(seed: int, real_gap: bool = True) -> list[Trajectory]:
    try:
        real, *_ = choose_real(RealConfig(seed=seed, real_gap=real_gap), TASK, SIZE)
    except InputError as error:
        pytest.skip(str(error))
    return real.collect(2)


def test_frames_keep_shape_and_dtype_and_lose_their_exactness(simulator):
    (plain, _), (gapped, _) = collect(simulator, None), collect(simulator, STILL)
    assert plain.frames.shape == (STEPS + 1, 2 * SIZE, 2 * SIZE, 3)
    assert gapped.frames.shape == (STEPS + 1, SIZE, SIZE, 3)
    assert gapped.frames.dtype == np.uint8
    assert gapped.actions.shape == (STEPS, 1)
    still = gapped.frames[:, :4, :4].astype(float)  # sky
    assert 0.5 < still.std(axis=0).mean() < 8  # noise that the video did not take away
    blocks = plain.frames[0].reshape(SIZE, 2, SIZE, 2, 3).mean((1, 3))
    assert 1 < np.abs(gapped.frames[0] - blocks).mean() < 8  # the same start, seen noisily


def test_brightness_is_a_factor_on_what_is_filmed(simulator):
    rng = np.random.default_rng(0)
    frames = np.full((3, 2 * SIZE, 2 * SIZE, 3), 100, np.uint8)
    for brightness in (0.9, 1.1):
        seen = RealityGap(SIZE, brightness).film(frames, 0.05, rng)
        assert seen.mean() == pytest.approx(100 * brightness, abs=1.5)
    drawn = [RealityGap.draw(SIZE, seed).brightness for seed in range(50)]
    assert 0.9 <= min(drawn) < 0.92 < 1.08 < max(drawn) <= 1.1


def test_sizes_that_a_video_would_pad_are_kept():
    frames = np.zeros((3, 64, 64, 3), np.uint8)
    seen = RealityGap(21, brightness=1.0).film(frames, 0.05, np.random.default_rng(0))
    assert seen.shape == (3, 21, 21, 3)


def test_the_robot_follows_one_step_late_and_the_commands_are_recorded(simulator, monkeypatch):
    played, filmed = [], []

    def spy(self, *given, **options):
        played.append(play(self, *given, **options))
        return played[-1]

    def film(self, rollouts, stray=None):
        filmed.append(rollouts.states)
        return take(self, rollouts, stray)

    play, take = Simulator.play, Simulator.film
    monkeypatch.setattr(Simulator, "play", spy)
    monkeypatch.setattr(Simulator, "film", film)
    trajectories = collect(simulator, STILL)
    commanded = np.stack([t.actions for t in trajectories])
    assert (commanded != 0).all()
    # Until the first command arrives it does the same, as if it had been there before.
    np.testing.assert_allclose(played[0].actions[:, 0], commanded[:, 0], rtol=1e-6)
    np.testing.assert_allclose(played[0].actions[:, 1:], commanded, rtol=1e-6)
    speed = filmed[0][:, :, 3]  # a row is time, qpos (2), qvel (2), ...
    assert filmed[0].shape[1] == STEPS + 1
    pushed, command = np.diff(speed, axis=1)[:, 1:], commanded[:, :-1, 0]
    is_strong = np.abs(command) > 0.3  # the pole pushes the cart, too
    assert is_strong.mean() > 0.5
    assert (np.sign(pushed) == np.sign(command))[is_strong].mean() > 0.9


def test_the_same_seed_films_the_same_and_another_one_something_else(simulator):
    first, again, other = (collect(simulator, STILL, seed) for seed in (0, 0, 1))
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a.frames, b.frames)
        np.testing.assert_array_equal(a.actions, b.actions)
        assert (a.actions != c.actions).any()


def test_only_the_simulators_own_pictures_look_like_it(simulator):
    for gap in (None, STILL):
        real = PseudoReal(simulator, SPACE.nominal, episode_steps=STEPS, seed=0, gap=gap)
        assert real.observation.is_simulated is (gap is None)


def test_a_world_behind_a_gap_does_not_give_its_parameters_away(simulator):
    real = PseudoReal(simulator, SPACE.nominal, episode_steps=STEPS, seed=0, gap=STILL)
    public = {name for name in dir(real) if not name.startswith("_")}
    can = {"collect", "run_policy", "step_s", "observation"}
    assert public == {*can, "facts"}
    assert real.facts == {}
    for value in vars(real).values():
        assert isinstance(value, int | float | ObservationModel) or callable(value)
        assert not hasattr(value, "parameters")


@pytest.mark.thorough
@pytest.mark.opengl
def test_another_renderer_draws_what_is_behind_the_gap():
    gapped, again = drawn_by_opengl(4), drawn_by_opengl(4)
    plain = drawn_by_opengl(4, real_gap=False)
    for seen, same, clean in zip(gapped, again, plain, strict=True):
        assert seen.frames.shape == clean.frames.shape == (STEPS + 1, SIZE, SIZE, 3)
        np.testing.assert_array_equal(seen.frames, same.frames)
        difference = np.abs(seen.frames[0].astype(float) - clean.frames[0]).mean()
        assert 2 < difference < 30
        np.testing.assert_array_equal(seen.actions, clean.actions)


def test_a_gap_without_opengl_is_refused_in_one_line(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(opengl, "find_library", lambda name: None)
    # Other tests may have had renderers kept.
    monkeypatch.setattr("simtune.simulation.rendering.renderers.make_renderer", make_renderer)
    with pytest.raises(InputError, match="the opengl renderer cannot be used"):
        choose_real(RealConfig(real_gap=True), TASK, SIZE)


def test_an_arm_that_is_only_measured_moves_late_behind_a_gap(tmp_path):
    task, films = load_task(str(write_arm(tmp_path))), []
    for real_gap in (False, True):
        config = TuneConfig(task=task.source, out=tmp_path, real_gap=real_gap)
        real, *_ = choose_real(config, task, SIZE)
        films += real.collect(1)
    plain, gapped = films
    assert gapped.frames.shape == (task.episode_steps + 1, 0, 0, 3)
    np.testing.assert_array_equal(gapped.actions, plain.actions)
    off = np.abs(gapped.readings["encoders"] - plain.readings["encoders"])
    assert off.max() > 0.02  # ten times the noise


def test_a_gap_needs_a_pseudo_real_world(tmp_path):
    config = TuneConfig(task="cartpole", out=tmp_path, real="recordings", real_gap=True)
    with pytest.raises(InputError, match="--real-gap goes with --real pseudo only"):
        config.check()


@pytest.mark.thorough
@pytest.mark.parametrize(("real_gap", "supersampling"), [(False, 1), (True, 2)])
def test_tuning_averages_over_pixels_where_the_real_camera_does(
    tmp_path, quick, monkeypatch, real_gap, supersampling
):
    def simulator(_gap, task, views):
        return task.simulator(image_size=128, views=views)

    monkeypatch.setattr(RealityGap, "simulator", simulator)
    config = TuneConfig(task="cartpole", out=Path(tmp_path / "run"), real_gap=real_gap)
    experiment = build_experiment(dataclasses.replace(config, real_episodes=1), settings=quick)
    assert experiment.simulator.supersampling == supersampling


# --- policies behind the gap --------------------------------------------------------------


def test_an_action_is_carried_out_late_and_the_first_one_before():
    commands, states = np.arange(1.0, 6)[:, None], np.zeros((1, 4))
    act = acting_late(lambda t, states: commands[None, t], 2)
    carried_out = [float(act(t, states)[0, 0]) for t in range(5)]
    assert carried_out == [1, 1, 1, 2, 3]
    assert carried_out == delayed(commands, 2)[:, 0].tolist()  # as recordings are fitted
    prompt = acting_late(lambda t, states: commands[None, t], 0)
    assert [float(prompt(t, states)[0, 0]) for t in range(3)] == [1, 2, 3]


def test_a_policy_sees_what_the_gaps_camera_delivers_and_acts_a_step_late(simulator, monkeypatch):
    gap = RealityGap(SIZE, brightness=1.1)
    real = PseudoReal(simulator, SPACE.nominal, episode_steps=STEPS, seed=0, gap=gap)
    seen, played = [], []
    play = Simulator.play

    def spy(*given, **options):
        played.append(play(*given, **options))
        return played[-1]

    def push(frames: np.ndarray) -> np.ndarray:
        seen.append(frames.copy())
        return np.full((len(frames), 1), 1.0 if len(seen) == 1 else 0.0)  # once, at first

    monkeypatch.setattr(Simulator, "play", spy)
    first, second = real.run_policy(push, 3, 2, seed=0)
    assert first.frames.shape == (STEPS + 1, SIZE, SIZE, 3)
    np.testing.assert_array_equal(seen[5][0, -1], first.frames[5])  # the recorded ones
    np.testing.assert_array_equal(first.actions[:, 0], [1.0] + [0.0] * (STEPS - 1))
    np.testing.assert_array_equal(second.actions, first.actions)
    np.testing.assert_array_equal(played[0].actions[:, :3, 0], [[1, 1, 0]] * 2)
    again, _ = real.run_policy(lambda frames: np.zeros((len(frames), 1)), 3, 2, seed=0)
    np.testing.assert_array_equal(again.frames[0], first.frames[0])


def test_latest_actions_belong_to_the_state_where_they_may_be_late():
    simulator = TASK.simulator(image_size=SIZE)
    environment = PolicyWorlds(TASK, simulator, 1, max_delay_steps=2)
    told: list[np.ndarray] = []

    def policy(observation: Observation) -> np.ndarray:
        told.append(observation.state)
        return np.full((2, 1), 0.05 * len(told))

    worlds = np.tile(SPACE.nominal, (2, 1))
    episodes = environment.play(policy, worlds, np.random.default_rng(0), False, delay_steps=1)
    assert told[0].shape == (2, environment.num_states)
    latest = [state[0, -2:] for state in told[:3]]
    np.testing.assert_allclose(latest, [[0, 0], [0.05, 0], [0.1, 0.05]], rtol=1e-6)
    np.testing.assert_array_equal(episodes.states[:, :-1], np.stack(told, 1))
    last = [0.05 * STEPS, 0.05 * (STEPS - 1)]
    np.testing.assert_allclose(episodes.states[:, -1, -2:], [last] * 2, rtol=1e-6)
    np.testing.assert_allclose(episodes.actions[0, :, 0], 0.05 * np.arange(1, STEPS + 1), rtol=1e-6)
    assert environment.num_positions == PolicyWorlds(TASK, simulator, 1).num_positions


def test_a_delay_moves_what_happens_by_its_steps():
    simulator = TASK.simulator(image_size=SIZE)
    worlds, environment = SPACE.nominal[None], PolicyWorlds(TASK, simulator, 1, max_delay_steps=2)

    def accelerations(delay_steps: int) -> np.ndarray:
        rng, pushes = np.random.default_rng(0), itertools.chain([0.0], itertools.repeat(1.0))
        push = lambda _: np.full((1, 1), next(pushes))  # noqa: E731  from the second step on
        played = environment.play(push, worlds, rng, False, delay_steps)
        return np.abs(np.diff(played.full_states[0, :, 3]))  # of the cart

    for delay_steps in (0, 1, 2):
        assert np.argmax(accelerations(delay_steps) > 0.5) == 1 + delay_steps


def test_delays_of_simulated_episodes_are_about_what_was_found():
    rng, any_real = np.random.default_rng(0), ObservationModel.of_reality()
    simulator = SimpleNamespace(space=SPACE, num_actions=1)
    training = SimpleNamespace(
        config=SimpleNamespace(method="autotune"),
        scored_in=SimpleNamespace(gap=None),
        learnt_in=SimpleNamespace(max_delay_steps=2),
        simulator=simulator,
        real=SimpleNamespace(observation=any_real),
        declared_late_steps=0.0,
    )
    drawn = partial(TrainingExperiment.delay_steps, training, rng=rng)
    assert {drawn(1.0) for _ in range(20)} == {1}
    assert {drawn(-0.2) for _ in range(20)} == {0}
    assert {drawn(2.4) for _ in range(20)} == {2}  # a policy remembers no more actions
    later = [drawn(0.6) for _ in range(400)]
    assert set(later) == {0, 1}
    assert np.mean(later) == pytest.approx(0.6, abs=0.08)
    simulator.space = ParameterSpace([*SPACE, delay("late", ("slide",), 0.05)])
    assert drawn(1.0) == 0  # the parameter is all there is


@pytest.mark.parametrize(("real", "declared"), [("film", 2), ("xarm", 2), ("pseudo", 0)])
def test_pictures_are_as_late_to_a_policy_as_their_camera_declares(real, declared):
    """But not in a pseudo-real world, whose pictures are in time."""
    observation = ObservationModel.of_reality(films=[Footage(latency_s=0.1)])
    world = SimpleNamespace(
        config=SimpleNamespace(real=real, method="autotune"),
        real=SimpleNamespace(observation=observation, step_s=0.05),
        simulator=SimpleNamespace(step_s=0.05, space=SPACE, num_actions=1),
        scored_in=SimpleNamespace(gap=None),
        space=SPACE,
    )
    assert _max_delay_steps(world) == 2 + declared
    world.learnt_in = SimpleNamespace(max_delay_steps=_max_delay_steps(world))
    world.declared_late_steps = TrainingExperiment.declared_late_steps.fget(world)
    assert world.declared_late_steps == declared
    drawn = partial(TrainingExperiment.delay_steps, world, rng=np.random.default_rng(0))
    assert drawn(0.0) == declared  # as a search of recordings that are put in time finds
    assert drawn(1.0) == 1 + declared
    assert {drawn(None) for _ in range(40)} == {declared, declared + 1, declared + 2}
    world.config.method = "untuned"
    assert drawn(None) == declared
    world.config.method = "dr"
    world.space = world.simulator.space = ParameterSpace([*SPACE, delay("late", ("slide",), 0.05)])
    assert drawn(None) == declared
    assert _max_delay_steps(world) == 1 + declared


def test_actions_on_their_way_belong_to_the_state_where_a_delay_is_a_parameter():
    world = SimpleNamespace(
        config=SimpleNamespace(real="pseudo"),
        real=SimpleNamespace(observation=ObservationModel.of_simulator()),
        simulator=SimpleNamespace(step_s=0.02, space=SPACE, num_actions=1),
        space=ParameterSpace([*SPACE, delay("late", ("slide",), 0.05)]),
    )
    assert _max_delay_steps(world) == 3
    world.space = SPACE
    assert _max_delay_steps(world) == 0


def test_noisy_cameras_do_to_tensors_what_the_noise_says():
    generator = torch.Generator().manual_seed(0)
    pictures = torch.zeros(500, 3, 4, 4)  # half of the full scale
    seen = (NoisyCameras.draw(ImageNoise(), 500, generator)(pictures) + 1) / 2
    level = seen.mean((2, 3))
    assert float(level.mean()) == pytest.approx(0.5, abs=0.01)
    # Of .5: brightness and tint, offset, and an exponent (.5^γ changes by .5 ln .5 of it)
    expected = np.linalg.norm([0.03, 0.01, 0.01, 0.5 * np.log(2) * 0.05])
    assert float(level.std(0).mean()) == pytest.approx(expected, rel=0.15)
    assert float(seen.std((2, 3)).mean()) == pytest.approx(0.025 / 2, rel=0.15)
    dot = torch.full((1, 3, 5, 5), -1.0)
    dot[:, :, 2, 2] = 1.0
    none = ImageNoise(gain=0, tint=0, offset=0, gamma=0, noise=0)
    still = NoisyCameras.draw(none, 1, generator)
    blur, found = float(still.blur), (still(dot) + 1) / 2
    assert float(found[0, 0, 2, 2]) == pytest.approx(1 - blur + blur / 4, abs=1e-5)
    assert float(found[0, 0, 2, 3]) == pytest.approx(blur / 8, abs=1e-5)


def test_noisy_cameras_smooth_colours_as_videos_do():
    generator, none = (
        torch.Generator().manual_seed(1),
        ImageNoise(gain=0, tint=0, offset=0, gamma=0, noise=0),
    )
    camera = NoisyCameras.draw(none, 1, generator)._replace(blur=torch.zeros(1, 1, 1, 1))
    drawn = np.random.default_rng(0).random((7, 7, 3), np.float32)
    seen = (camera(torch.tensor(2 * drawn - 1).permute(2, 0, 1)[None]) + 1) / 2
    share = float(camera.blur_of_chroma)
    assert 0 < share < 1
    expected = (1 - share) * drawn + share * with_smooth_chroma(drawn)
    np.testing.assert_allclose(seen[0].permute(1, 2, 0), expected.clip(0, 1), atol=1e-5)


@pytest.mark.thorough
def test_methods_know_more_or_less_of_the_gaps_delay(tmp_path, quick, monkeypatch):
    drawn = staticmethod(lambda task, views: task.simulator(image_size=64, views=views))
    monkeypatch.setattr(RealityGap, "simulator", drawn)
    rng = np.random.default_rng(0)
    for method, expected in (("dr", {0, 1, 2}), ("untuned", {0}), ("oracle", {1})):
        config = config_of(tmp_path / method, real_gap=True, method=method)
        experiment = build_training(config, settings=quick)
        assert {experiment.delay_steps(None, rng) for _ in range(40)} == expected


@pytest.mark.thorough
def test_a_policy_is_filmed_and_scored_behind_the_gap(tmp_path, quick, monkeypatch):
    films: list[int] = []
    film = RealityGap.film

    def spy(self, frames, *others):
        films.append(len(frames))
        return film(self, frames, *others)

    drawn = staticmethod(lambda task, views: task.simulator(image_size=64, views=views))
    monkeypatch.setattr(RealityGap, "simulator", drawn)
    monkeypatch.setattr(RealityGap, "film", spy)
    episodes = {"real_episodes": 2, "tried_episodes": 1, "scored_episodes": 3}
    config = config_of(tmp_path / "run", real_gap=True, method="regression", **episodes)
    settings = by_few_windows(config)
    result = train(config, settings=settings)
    # Two random episodes, whole; then each frame that a policy sees, in one world and in three.
    assert films[:2] == [25, 25]
    assert films.count(1) == 25
    assert films.count(3) == 2 * 25  # after each of both cycles
    assert result["return"]["episodes"] == 3
    lines = read_jsonl(tmp_path / "run" / "metrics.jsonl")
    assert len([line for line in lines if "return/real" in line]) == 1
    again = evaluate(EvaluateConfig(run_folder=tmp_path / "run", episodes=3, seed=0), settings)
    assert again["mean"] == pytest.approx(result["return"]["mean"], rel=1e-6)
