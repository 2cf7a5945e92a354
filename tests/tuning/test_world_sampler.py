"""Simulated worlds to learn from: what they play, what is filmed of them, how many there are."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from late_actuators import delay
from search_context import CARTPOLE, SIZE, SPACE, START, STEPS, context_of, record_episodes

from simtune.budget import Budget
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.search_param_model.simulated import FilmedWorlds, play_worlds, whole_sets
from simtune.simulation import Rollouts, Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.world_sampler import WorldSampler

FIRST = Distribution.first(SPACE, START)


@pytest.fixture
def simulator() -> Simulator:
    return CARTPOLE.simulator(image_size=SIZE)


@pytest.fixture(scope="module")
def real() -> list[Trajectory]:
    return record_episodes(CARTPOLE.simulator(image_size=SIZE), 3)


def watch_rollouts(monkeypatch, simulator: Simulator, change: Callable = lambda played: played):
    """All that the simulator rolls out from now on, before it is changed."""
    played, roll_out = [], simulator.roll_out

    def watched(*args, **options):
        played.append(roll_out(*args, **options))
        return change(played[-1])

    monkeypatch.setattr(simulator, "roll_out", watched)
    return played


def without(rollouts: Rollouts, dropped: list[int]) -> Rollouts:
    kept = np.setdiff1d(np.arange(len(rollouts)), dropped)
    return Rollouts(*(array[kept] for array in vars(rollouts).values()))


def test_simulated_worlds_replay_the_real_actions(simulator, real):
    worlds, pictures = WorldSampler(context_of(simulator)).play_and_draw(
        real, FIRST, 16, 2, 4, Budget()
    )
    assert worlds.actions.shape == (16, 2, STEPS, 1)
    assert worlds.keypoints.shape[:3] == (16, 2, STEPS + 1)
    assert pictures.frames.shape == (64, SIZE, SIZE, 3)
    recorded = [t.actions.astype(float) for t in real]
    used = set()
    for world in worlds.actions:
        played = [
            next(i for i, actions in enumerate(recorded) if np.array_equal(actions, episode))
            for episode in world
        ]
        assert len(set(played)) == 2  # no episode twice in one world
        used |= set(played)
    assert used == {0, 1, 2}
    assert len(np.unique(worlds.parameters, axis=0)) == 16
    assert ((worlds.parameters >= FIRST.low) & (worlds.parameters <= FIRST.high)).all()


def test_simulated_worlds_are_cut_to_the_shortest_real_episode(simulator, real):
    shorter = Trajectory(real[1].frames[:-2], real[1].actions[:-2], real[1].step_s)
    sampler = WorldSampler(context_of(simulator))
    worlds = sampler.play([real[0], shorter], FIRST, 4, 2, Budget())
    assert worlds.actions.shape[1:3] == (2, STEPS - 2)


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def slow_down(monkeypatch, simulator: Simulator) -> None:
    """By a clock of their own a world's step takes a millisecond, and a picture three."""
    play, render, clock = simulator.play, simulator.render, Clock()

    def slow_play(parameters, act, num_steps, rng, **options):
        clock.now_s += 1e-3 * len(parameters) * num_steps
        return play(parameters, act, num_steps, rng, **options)

    def slow_render(states, parameters, stray=None):
        clock.now_s += 3e-3 * len(states)
        return render(states, parameters, stray)

    monkeypatch.setattr(time, "monotonic", clock)
    monkeypatch.setattr(simulator, "play", slow_play)
    monkeypatch.setattr(simulator, "render", slow_render)


@pytest.mark.thorough
def test_worlds_are_sampled_64_at_a_time_until_the_time_is_over(monkeypatch, simulator, real):
    slow_down(monkeypatch, simulator)
    sampler = WorldSampler(context_of(simulator))
    chunk_s = 64 * (1e-3 * 2 * STEPS + 3e-3 * 4)

    def sample(num_worlds: int, seconds: float) -> int:
        return len(sampler.play_and_draw(real, FIRST, num_worlds, 2, 4, Budget(seconds))[0].actions)

    assert sample(256, 1.9 * chunk_s) == 64, "more would end too late"
    assert sample(256, 2.1 * chunk_s) == 128
    assert sample(256, 3.1 * chunk_s) == 192
    # However little time there is, there are some to learn from; and never more than asked for.
    assert sample(256, 0.0) == 64
    assert sample(20, 0.0) == 20
    assert sample(70, 1e6) == 70


def test_worlds_of_several_chunks_are_all_there_and_each_is_whole(monkeypatch, simulator, real):
    rollouts = watch_rollouts(monkeypatch, simulator)
    worlds, pictures = WorldSampler(context_of(simulator)).play_and_draw(
        real, FIRST, 130, 2, 4, Budget()
    )
    assert [len(played) for played in rollouts] == [2 * 64, 2 * 66]
    for name, array in vars(worlds).items():
        if name != "readings":
            assert len(array) == 130, name
    assert len(np.unique(worlds.parameters, axis=0)) == 130
    last = rollouts[1]
    np.testing.assert_array_equal(worlds.parameters[64:], last.parameters[::2])
    np.testing.assert_array_equal(worlds.actions[69], last.actions[10:12])
    keypoints = worlds.keypoints[69].reshape(2, STEPS + 1, -1)
    np.testing.assert_array_equal(keypoints, last.observed[10:12])
    assert not isinstance(worlds, FilmedWorlds)
    assert len(pictures.frames) == len(pictures.keypoints) == len(pictures.parameters) == 4 * 130


def test_joined_worlds_have_the_readings_of_all(simulator, real):
    sampler = WorldSampler(context_of(simulator))
    parts = [sampler.film(real, FIRST, num, 4, Budget()) for num in (5, 4)]
    measured = [np.full((num, 4, 1), float(num)) for num in (5, 4)]
    parts = [replace(p, readings={"angle": m}) for p, m in zip(parts, measured, strict=True)]
    joined = FilmedWorlds.joined(parts)
    np.testing.assert_array_equal(joined.readings["angle"], np.concatenate(measured))
    np.testing.assert_array_equal(joined.frames[5:], parts[1].frames)


def test_filmed_frames_show_the_steps_they_are_said_to(monkeypatch, simulator, real):
    sampler = WorldSampler(context_of(simulator))
    rollouts = watch_rollouts(monkeypatch, simulator)
    worlds = sampler.film(real, FIRST, 16, 4, Budget())
    (played,) = rollouts
    for world in range(0, 16, 5):
        np.testing.assert_array_equal(played.parameters[world], worlds.parameters[world])
        states = played.states[world, worlds.filmed_from[world] :][:4]
        expected = simulator.render(states, np.tile(worlds.parameters[world], (4, 1)))
        np.testing.assert_array_equal(worlds.frames[world], expected)
        np.testing.assert_array_equal(worlds.states[world], states)


def test_worlds_of_which_an_episode_diverged_are_left_out(monkeypatch, simulator, real):
    sampler = WorldSampler(context_of(simulator))
    rollouts = watch_rollouts(
        monkeypatch, simulator, lambda played: without(played, [0, 7, 10, 11, 31])
    )
    worlds = sampler.play(real, FIRST, 16, 2, Budget())
    (whole,) = rollouts
    left = [w for w in range(16) if w not in (0, 3, 5, 15)]
    np.testing.assert_array_equal(worlds.parameters, whole.parameters[::2][left])
    for i, world in enumerate(left):
        np.testing.assert_array_equal(worlds.actions[i], whole.actions[2 * world : 2 * world + 2])
        keypoints = worlds.keypoints[i].reshape(2, STEPS + 1, -1)
        np.testing.assert_array_equal(keypoints, whole.observed[2 * world : 2 * world + 2])


def test_sampling_says_so_when_all_worlds_diverge(monkeypatch, simulator, real):
    sampler = WorldSampler(context_of(simulator))
    watch_rollouts(monkeypatch, simulator, lambda played: without(played, list(range(32))))
    with pytest.raises(RuntimeError, match="diverged"):
        sampler.play(real, FIRST, 16, 2, Budget())


def test_whole_sets_by_hand():
    index = np.array([0, 1, 3, 4, 5, 7, 8, 9])  # 2 and 6 are not there
    np.testing.assert_array_equal(whole_sets(index, 2), [[0, 1], [3, 4], [6, 7]])


@pytest.mark.thorough
@pytest.mark.parametrize("is_tuned", [False, True])
def test_actions_are_late_in_half_the_real_cameras_worlds_unless_a_delay_is_tuned(
    monkeypatch, real, is_tuned
):
    late = ParameterSpace([*SPACE, delay("late", ("slide",), 0.16)])
    task = replace(CARTPOLE, parameters=late) if is_tuned else CARTPOLE
    simulator = task.simulator(image_size=SIZE)
    actions = np.stack([t.actions for t in real])[None].repeat(12, 0)
    nominal = np.repeat(simulator.space.nominal[None], 12, 0)
    keypoints = context_of(simulator, nominal[0]).keypoints
    rollouts = watch_rollouts(monkeypatch, simulator)
    rng = np.random.default_rng(0)
    reality = ObservationModel.of_reality()
    worlds = play_worlds(simulator, keypoints, nominal, actions, rng, reality)
    played = rollouts[0].actions.reshape(12, 3, STEPS, 1)
    as_asked = (played == actions).all((1, 2, 3))
    one_later = (played == delayed(actions, 1)).all((1, 2, 3))
    assert (as_asked | one_later).all()
    assert as_asked.all() if is_tuned else 2 < one_later.sum() < 10
    np.testing.assert_array_equal(worlds.actions, actions)  # what was asked for, as recordings say
