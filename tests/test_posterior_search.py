"""search="posterior" as a whole: what it simulates, that it resumes, and that it finds."""

import itertools
import json
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from simtune.errors import InputError
from simtune.parameters import ParameterSpace, delay
from simtune.randomization import Distribution
from simtune.real.truth import Truth
from simtune.search_param_model import simulated
from simtune.simulation import Rollouts, Simulator
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoints import find_keypoints

SIZE = 32  # pixels
STEPS = 24
CARTPOLE = load_task("cartpole")
SPACE = CARTPOLE.parameters
START = SPACE.clip(SPACE.nominal * np.where(np.arange(len(SPACE)) % 2, 2, 0.5))


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return CARTPOLE.simulator(image_size=SIZE)


@pytest.fixture(scope="module")
def real(simulator) -> list[Trajectory]:
    world = Truth(SPACE, SPACE.nominal).make_real(simulator, episode_steps=STEPS, seed=1)
    return world.collect(3)


def far_away() -> float:
    return time.monotonic() + 1e6


def start(simulator: Simulator, config: PosteriorSearchConfig, seed: int = 0) -> PosteriorSearch:
    return PosteriorSearch(simulator, CARTPOLE.camera, START, config, seed=seed)


def taught_worlds(search: PosteriorSearch, monkeypatch) -> list:
    """The worlds that the detector is taught on, as they come; the posterior network is on the same."""
    seen = []
    train_detector = search.model.train_detector

    def spy(worlds, *rest):
        seen.append(worlds)
        return train_detector(worlds, *rest)

    monkeypatch.setattr(search.model, "train_sight", spy)
    return seen


def test_an_iteration_gives_estimates_and_a_range(simulator, real, tiny):
    search = start(simulator, tiny)
    np.testing.assert_array_equal(search.distribution.mean, START)
    keys = []
    for iteration in range(tiny.iterations):
        assert not search.finished
        steps_before = simulator.num_steps
        estimate, _, losses = search.iterate(real, far_away())
        keys.append(set(losses))
        assert search.iteration == iteration + 1
        assert simulator.num_steps >= steps_before + tiny.num_worlds * 2 * STEPS
        for values in (estimate.mean, estimate.low, estimate.high):
            assert values.shape == (len(SPACE),)
            np.testing.assert_array_equal(values, SPACE.clip(values))
        assert (estimate.low <= estimate.high).all()
        assert set(estimate.curves) == set(SPACE.names)
        assert set(estimate.verdict) <= {"identified", "weak", "not identifiable"}
        assert np.isfinite(list(losses.values())).all()
    assert search.finished
    assert keys[0] == keys[1]


def test_simulated_worlds_replay_the_real_actions(simulator, real, tiny, monkeypatch):
    search = start(simulator, tiny)
    seen = taught_worlds(search, monkeypatch)
    search.iterate(real, far_away())
    (worlds,) = seen
    assert worlds.actions.shape == (16, 2, STEPS, 1)
    assert worlds.keypoints.shape[:3] == (16, 2, STEPS + 1)
    assert worlds.frames.shape == (16, 4, SIZE, SIZE, 3)
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
    low, high = search.first.low, search.first.high
    assert ((worlds.parameters >= low) & (worlds.parameters <= high)).all()


def test_few_worlds_where_steps_and_pictures_take_long(simulator, real, tiny, monkeypatch):
    config = replace(tiny, num_worlds=256, unseen_worlds=256)
    search = start(simulator, config)
    lessons = search._lessons
    seconds = 2 * STEPS * lessons._step_s  # a world's episodes, undrawn
    worlds = lessons._collect(real, search.first, 256, 2, 4, 100.5 * seconds)
    assert worlds.actions.shape[:3] == (100, 2, STEPS)
    assert lessons._step_s > 0
    assert lessons._frame_s >= 0
    lessons._step_s, lessons._frame_s = 1.0, 10.0
    drawn_s = 2 * STEPS * 1.0 + 4 * 10.0
    assert len(lessons._collect(real, search.first, 256, 2, 4, 80.5 * drawn_s).actions) == 80
    lessons._step_s, lessons._frame_s = 1.0, 10.0
    # However little time there is, there are some to learn from.
    assert len(lessons._collect(real, search.first, 256, 2, 4, 0.0).actions) == 64


def test_where_a_delay_is_tuned_no_hidden_one_comes_on_top(real):
    task = replace(CARTPOLE, parameters=ParameterSpace([*SPACE, delay("late", ("slide",), 0.16)]))
    rng, actions = np.random.default_rng(0), np.stack([t.actions for t in real])[None].repeat(8, 0)
    for late in (False, True):
        made = (task if late else CARTPOLE).simulator(image_size=SIZE)
        played, roll_out = [], made.roll_out

        def spy(parameters, actions, *rest, played=played, roll_out=roll_out):
            played.append(actions)
            return roll_out(parameters, actions, *rest)

        made.roll_out = spy
        nominal = np.repeat(made.space.nominal[None], 8, 0)
        points = find_keypoints(
            made, CARTPOLE.camera, Distribution.first(made.space, nominal[0]), 0
        )
        simulated.simulate(made, points, nominal, actions, 2, rng, ImageNoise())
        assert np.array_equal(played[-1], actions.reshape(24, STEPS, 1)) == late


def test_a_search_that_was_loaded_has_to_iterate_before_it_looks(simulator, real, tiny):
    search = start(simulator, tiny)
    with pytest.raises(RuntimeError, match="iterate first"):
        search.detect(real)


def test_filmed_frames_show_the_steps_they_are_said_to(simulator, real, tiny, monkeypatch):
    rollouts = []
    roll_out = simulator.roll_out

    def spy(*args, **kwargs):
        rollouts.append(roll_out(*args, **kwargs))
        return rollouts[-1]

    search = start(simulator, tiny)
    monkeypatch.setattr(simulator, "roll_out", spy)
    seen = taught_worlds(search, monkeypatch)
    search.iterate(real, far_away())
    (worlds,), played = seen, rollouts[0]
    for world in range(0, 16, 5):
        episode = 2 * world  # the first of its two
        np.testing.assert_array_equal(played.parameters[episode], worlds.parameters[world])
        states = played.states[episode, worlds.filmed_from[world] :][:4]
        expected = simulator.render(states, np.tile(worlds.parameters[world], (4, 1)))
        np.testing.assert_array_equal(worlds.frames[world], expected)


def without(rollouts: Rollouts, dropped: list[int]) -> Rollouts:
    kept = np.setdiff1d(np.arange(len(rollouts)), dropped)
    return Rollouts(*(array[kept] for array in vars(rollouts).values()))


def test_worlds_of_which_an_episode_diverged_are_left_out(simulator, real, tiny, monkeypatch):
    search = start(simulator, tiny)
    seen = taught_worlds(search, monkeypatch)
    roll_out = simulator.roll_out
    played = []

    def lose_some(*args, **kwargs):
        played.append(roll_out(*args, **kwargs))
        if len(played) > 1:
            return played[-1]
        return without(played[-1], [0, 7, 10, 11, 31])  # of worlds 0, 3, 5 and 15

    monkeypatch.setattr(simulator, "roll_out", lose_some)
    search.iterate(real, far_away())
    (worlds,), whole = seen, played[0]
    left = [w for w in range(16) if w not in (0, 3, 5, 15)]
    np.testing.assert_array_equal(worlds.parameters, whole.parameters[::2][left])
    for i, world in enumerate(left):
        np.testing.assert_array_equal(worlds.actions[i], whole.actions[2 * world : 2 * world + 2])
        keypoints = worlds.keypoints[i].reshape(2, STEPS + 1, -1)
        np.testing.assert_array_equal(keypoints, whole.observed[2 * world : 2 * world + 2])


def test_when_all_worlds_diverge_the_search_says_so(simulator, real, tiny, monkeypatch):
    search = start(simulator, tiny)
    roll_out = simulator.roll_out
    monkeypatch.setattr(
        simulator, "roll_out", lambda *a, **k: without(roll_out(*a, **k), list(range(32)))
    )
    with pytest.raises(RuntimeError, match="diverged"):
        search.iterate(real, far_away())


def test_sets_by_hand():
    index = np.array([0, 1, 3, 4, 5, 7, 8, 9])  # 2 and 6 are not there
    np.testing.assert_array_equal(simulated.whole_sets(index, 2), [[0, 1], [3, 4], [6, 7]])


def test_real_episodes_are_cut_to_the_shortest(simulator, real, tiny, monkeypatch):
    longer, shorter = real[0], real[1]
    shorter = Trajectory(shorter.frames[:-2], shorter.actions[:-2], shorter.step_s)
    search = start(simulator, replace(tiny, num_worlds=4))
    seen = taught_worlds(search, monkeypatch)
    search.iterate([longer, shorter], far_away())
    assert seen[0].actions.shape[1:3] == (2, STEPS - 2)


def test_episodes_too_short_to_be_judged_are_refused(simulator, real, tiny):
    search = start(simulator, tiny)
    short = Trajectory(real[0].frames[:11], real[0].actions[:10], 0.1)
    with pytest.raises(InputError, match="at least 21 steps, got one of 10"):
        search.check([real[0], short])
    with pytest.raises(InputError, match="got none"):
        search.check([])
    search.check(real)


def same_estimates(one, other) -> None:
    for key in ("mean", "low", "high"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key))
    assert one.verdict == other.verdict
    for name, (candidates, prob_higher) in one.curves.items():
        np.testing.assert_array_equal(candidates, other.curves[name][0])
        np.testing.assert_array_equal(prob_higher, other.curves[name][1])


def test_goes_on_from_a_checkpoint_bit_for_bit(simulator, real, tiny):
    config = replace(tiny, iterations=3)
    straight = start(simulator, config, seed=4)
    straight.iterate(real, far_away())
    tensors = {k: v.clone() for k, v in straight.tensors().items()}
    state = json.loads(json.dumps(straight.state()))
    first, second = (straight.iterate(real, far_away()) for _ in range(2))

    resumed = start(CARTPOLE.simulator(image_size=SIZE), config, seed=4)  # another process's
    resumed.load(tensors, state)
    assert resumed.iteration == 1
    for key in ("mean", "low", "high"):
        expected = np.array(state["distribution"][key])
        np.testing.assert_array_equal(getattr(resumed.distribution, key), expected)
    torch.rand(7)  # what others draw from torch does not matter
    np.random.rand(7)  # noqa: NPY002  nor from numpy
    for expected_estimate, expected_events, expected_losses in (first, second):
        estimate, events, losses = resumed.iterate(real, far_away())
        same_estimates(estimate, expected_estimate)
        assert events == expected_events
        assert losses == expected_losses
    for name, tensor in straight.tensors().items():
        assert torch.equal(tensor, resumed.tensors()[name]), name
    resumed_state, straight_state = resumed.state(), straight.state()
    assert resumed_state == straight_state


def test_a_seed_decides_all(simulator, real, tiny):
    one, other, another = (
        start(simulator, tiny, seed).iterate(real, far_away())[0] for seed in (1, 1, 2)
    )
    same_estimates(one, other)
    assert not np.array_equal(one.mean, another.mean)


def test_a_deadline_that_is_over_still_gives_an_estimate_soon(simulator, real, tiny):
    config = replace(tiny, detector_updates=(10**6,), posterior_updates=10**6, least_updates=5)
    search = start(simulator, config)
    began_s = time.monotonic()
    estimate, _, _ = search.iterate(real, began_s - 1)
    assert time.monotonic() - began_s < 15
    assert np.isfinite(estimate.mean).all()


def test_the_iteration_in_which_the_time_is_over_is_tested_on_known_worlds(simulator, real, tiny):
    in_time, _, _ = start(simulator, tiny).iterate(real, far_away())
    assert not in_time.ranks, "what is fitted once more needs no test"
    too_late, _, _ = start(simulator, tiny).iterate(real, time.monotonic() - 1)
    assert {len(ranks) for ranks in too_late.ranks.values()} == {tiny.replicas[0]}


def test_what_is_done_is_said_and_never_goes_back(simulator, real, tiny):
    said: list[tuple[str, float]] = []
    search = PosteriorSearch(
        simulator,
        CARTPOLE.camera,
        START,
        replace(tiny, detector_updates=(40,), posterior_updates=40),
        seed=0,
        say=lambda doing, done: said.append((doing, done)),
    )
    for _ in range(2):
        search.iterate(real, far_away())
    shares = [done for _, done in said]
    assert all(a <= b + 1e-9 for a, b in itertools.pairwise(shares))
    assert 0 <= shares[0] < shares[-1] <= 1
    words = [doing for doing, _ in said]
    assert any(w.startswith("1/2 ") for w in words)
    assert any(w.startswith("2/2 ") for w in words)
    assert {w[4:] for w in words} >= {"simulating and filming", "learning to see"}


@pytest.mark.slow
def test_finds_the_truth_of_a_ball_and_a_cup():
    task = load_task("ball_in_cup")
    space = task.parameters
    truth = Truth(space, space.nominal)
    simulator = task.simulator(image_size=64)
    real = truth.make_real(simulator, episode_steps=task.episode_steps, seed=5).collect(4)
    config = PosteriorSearchConfig(
        num_worlds=128, iterations=3, detector_updates=(1200, 500), posterior_updates=700
    )
    start = truth.wrong_start(5)
    search = PosteriorSearch(simulator, task.camera, start, config, seed=5)
    for _ in range(config.iterations):
        estimate, _, _ = search.iterate(real, far_away())
    _, percent_error = truth.score(estimate.mean)
    assert truth.score(start)[1].mean() > 40
    assert percent_error.mean() < 15, dict(zip(space.names, percent_error, strict=True))
    assert estimate.verdict[space.index("ball_mass")] != "not identifiable"
    inside = (estimate.low <= space.nominal) & (space.nominal <= estimate.high)
    assert inside.mean() >= 0.6  # 90 % intervals, of few updates
