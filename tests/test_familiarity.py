"""Whether real episodes are where simulated worlds are that replay the same actions."""

import numpy as np
import pytest

from simtune.search_param_model.simulated import SimulatedWorlds
from simtune.tuning import familiarity
from simtune.tuning.estimate import Estimate
from simtune.tuning.familiarity import STRANGE, are_strange, doubted
from simtune.tuning.fit_stage import Detected, HeldOut
from simtune.vision.detector import Detections

WORLDS, EPISODES, STEPS, KEYPOINTS, SIZE = 60, 2, 50, 4, 64


def falling(num: int, rng: np.random.Generator, upright: float = 0.0) -> np.ndarray:
    """(num, STEPS + 1, L, 2) keypoints of robots that fall, each in its own way, by 30 pixels.

    A share `upright` of the way is not fallen.
    """
    t = np.linspace(0, 1, STEPS + 1)[:, None, None]
    place = rng.normal(32, 3, (num, 1, KEYPOINTS, 2))
    speed = rng.normal(1, 0.2, (num, 1, 1, 1))
    way = np.array([0.0, 30.0]) * (1 - upright)
    return place + np.clip(speed * 2 * t, 0, 1) * way


def detected(places: np.ndarray) -> Detections:
    """(n, L, 2) places as detections."""
    n = len(places)
    return Detections(places, *(np.zeros((n, 0)) for _ in range(4)))


def held_out(rng: np.random.Generator, error: float) -> HeldOut:
    """Forty pictures of worlds, in which the detector is off by `error` pixels."""
    seen = falling(8, rng)[:, :5]
    worlds = SimulatedWorlds(
        parameters=np.zeros((8, 1)),
        actions=np.zeros((8, 1, STEPS, 1)),
        keypoints=np.repeat(seen[:, None], 1, 1),
        frames=np.zeros((8, 5, SIZE, SIZE, 3), np.uint8),
        filmed_from=np.zeros(8, int),
        states=np.zeros((8, 5, 1)),
    )
    found = seen.reshape(40, KEYPOINTS, 2) + rng.normal(0, error, (40, KEYPOINTS, 2))
    return HeldOut(worlds, detected(found))


def strange(real: np.ndarray, seed: int, worlds: np.ndarray | None = None) -> bool:
    """For (n, T + 1, L, 2) real places, off by a pixel as in worlds."""
    rng = np.random.default_rng((1, seed))
    if worlds is None:
        worlds = falling(WORLDS * EPISODES, rng)
        worlds = worlds.reshape(WORLDS, EPISODES, STEPS + 1, KEYPOINTS, 2)
    films = [detected(episode + rng.normal(0, 1, episode.shape)) for episode in real]
    return are_strange(worlds, held_out(rng, 1.0), Detected([], films))


def test_a_robot_that_falls_as_worlds_do_is_not_strange():
    told = [strange(falling(5, np.random.default_rng(seed)), seed) for seed in range(10)]
    assert sum(told) <= 1


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_a_policy_keeps_upright_is_strange(seed):
    assert strange(falling(5, np.random.default_rng(seed), upright=0.8), seed)


def test_worlds_that_hardly_differ_do_not_make_small_errors_strange():
    """As after a range was narrowed, in films whose pictures are a little different."""
    one = falling(1, np.random.default_rng(0))
    worlds = one + np.random.default_rng(1).normal(0, 0.1, (WORLDS, EPISODES, *one.shape[1:]))
    assert not strange(one + 0.5, 0, worlds)
    assert strange(one + 8.0, 0, worlds)


def test_without_visible_motion_nothing_is_strange():
    worlds = np.zeros((WORLDS, EPISODES, STEPS + 1, 0, 2))
    films = [detected(np.zeros((STEPS + 1, 0, 2)))]
    assert not are_strange(worlds, held_out(np.random.default_rng(0), 1.0), Detected([], films))


def test_the_distance_is_a_median_over_keypoints_to_the_third_nearest_world(monkeypatch):
    """By hand: worlds at 1, 2, 4 and 8 px along x; one of three keypoints is anywhere."""
    worlds = np.zeros((4, 1, 3, 2))
    worlds[:, 0, :, 0] = np.array([1.0, 2.0, 4.0, 8.0])[:, None]
    some = np.zeros((1, 1, 3, 2))
    some[0, 0, 2] = 500.0
    distance = familiarity._distances(some, worlds, None, 3.0)
    assert distance == pytest.approx(np.full((1, 1), 5.0))  # √(4² + 3²)
    others = np.array([[True, False, True, True]])
    distance = familiarity._distances(some, worlds, others, 6.0)
    assert distance == pytest.approx(np.full((1, 1), 10.0))  # √(8² + 6²)


def test_nothing_is_identified_by_strange_videos():
    estimate = Estimate(*np.zeros((3, 3)), ["identified", "weak", "not identifiable"])
    told = doubted(estimate)
    assert told.verdict == ["weak", "weak", "not identifiable"]
    assert told.warnings == [STRANGE]
