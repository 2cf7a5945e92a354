"""Whether real episodes are where simulated worlds are that replay the same actions."""

import numpy as np
import pytest

from simtune.search_param_model.simulated import FilmedWorlds
from simtune.tuning import familiarity
from simtune.tuning.estimate import Estimate
from simtune.tuning.familiarity import (
    NOT_STRANGE,
    STRANGE,
    Strangeness,
    doubted,
    measure_strangeness,
)
from simtune.tuning.learning import Detected, HeldOut
from simtune.verdicts import Verdict
from simtune.vision.detections import Detections

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
    worlds = FilmedWorlds(
        parameters=np.zeros((8, 1)),
        actions=np.zeros((8, 1, STEPS, 1)),
        keypoints=np.repeat(seen[:, None], 1, 1),
        frames=np.zeros((8, 5, SIZE, SIZE, 3), np.uint8),
        filmed_from=np.zeros(8, int),
        states=np.zeros((8, 5, 1)),
    )
    found = seen.reshape(40, KEYPOINTS, 2) + rng.normal(0, error, (40, KEYPOINTS, 2))
    return HeldOut(worlds, detected(found))


def strange(real: np.ndarray, seed: int, worlds: np.ndarray | None = None) -> Strangeness:
    """Of (n, T + 1, L, 2) real places, off by a pixel as in worlds."""
    rng = np.random.default_rng((1, seed))
    if worlds is None:
        worlds = falling(WORLDS * EPISODES, rng)
        worlds = worlds.reshape(WORLDS, EPISODES, STEPS + 1, KEYPOINTS, 2)
    films = [detected(episode + rng.normal(0, 1, episode.shape)) for episode in real]
    return measure_strangeness(worlds, held_out(rng, 1.0), Detected([], films))


def test_controllers_other_than_policies_are_named_and_what_to_do_where_one_is_needed():
    for part in ("a firmware's PD", "a teleoperator who corrects", "[[sensors]]"):
        assert part in STRANGE


def test_a_robot_that_falls_as_worlds_do_is_not_strange():
    told = [strange(falling(5, np.random.default_rng(seed)), seed) for seed in range(10)]
    assert sum(found.clearly for found in told) == 0
    assert sum(found.perhaps for found in told) <= 1


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_a_policy_keeps_upright_is_strange(seed):
    found = strange(falling(5, np.random.default_rng(seed), upright=0.8), seed)
    assert found == Strangeness(clearly=True, perhaps=True)


def test_worlds_that_hardly_differ_do_not_make_small_errors_strange():
    """As after a range was narrowed, in films whose pictures are a little different."""
    one = falling(1, np.random.default_rng(0))
    worlds = one + np.random.default_rng(1).normal(0, 0.1, (WORLDS, EPISODES, *one.shape[1:]))
    assert strange(one + 0.5, 0, worlds) == NOT_STRANGE
    assert strange(one + 8.0, 0, worlds).clearly


def test_without_visible_motion_nothing_is_strange():
    worlds = np.zeros((WORLDS, EPISODES, STEPS + 1, 0, 2))
    films = [detected(np.zeros((STEPS + 1, 0, 2)))]
    found = measure_strangeness(
        worlds, held_out(np.random.default_rng(0), 1.0), Detected([], films)
    )
    assert found == NOT_STRANGE


def test_the_distance_is_a_median_over_keypoints_to_the_third_nearest_world():
    """By hand: worlds at 1, 2, 4 and 8 px along x; one of three keypoints is anywhere."""
    worlds = np.zeros((4, 1, 3, 2))
    worlds[:, 0, :, 0] = np.array([1.0, 2.0, 4.0, 8.0])[:, None]
    some = np.zeros((1, 1, 3, 2))
    some[0, 0, 2] = 500.0
    assert familiarity._distances(some, worlds) == 4.0
    assert familiarity._distances(some, worlds, np.array([[True, False, True, True]])) == 8.0


def test_shares_are_of_the_worlds_that_are_nearer_at_that_step():
    usual = np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0], [4.0, 8.0]])
    shares = familiarity._shares(np.array([[2.5, 6.5], [9.0, 5.0]]), usual)
    np.testing.assert_array_equal(shares, [[0.5, 0.5], [1.0, 0.0]])


@pytest.mark.parametrize(
    ("strange", "distance", "is_doubted"),
    [
        (Strangeness(clearly=True, perhaps=True), 0.5, True),
        (Strangeness(clearly=False, perhaps=True), 0.5, False),
        (Strangeness(clearly=False, perhaps=True), 0.8, True),  # in known worlds at most 0.6
        (Strangeness(clearly=False, perhaps=True), None, False),
        (NOT_STRANGE, 0.8, False),
    ],
)
def test_nothing_is_identified_by_strange_videos(strange, distance, is_doubted):
    off = {"unit": "px", "distance": distance, "known_worlds": [0.4, None, 0.6]}
    verdict: list[Verdict] = ["identified", "weak", "not identifiable"]
    held_out = {"episode": 1, "sensors": {"keypoints": off}}
    told = doubted(Estimate(*np.zeros((3, 3)), verdict, held_out=held_out), strange)
    assert told.verdict == (["weak", *verdict[1:]] if is_doubted else verdict)
    assert told.warnings == [STRANGE] * is_doubted
    assert doubted(told, strange) == told


def test_without_known_worlds_only_clearly_strange_videos_are_doubted():
    estimate = Estimate(*np.zeros((3, 1)), ["weak"])
    assert doubted(estimate, Strangeness(clearly=False, perhaps=True)) == estimate
    assert doubted(estimate, Strangeness(clearly=True, perhaps=True)).warnings == [STRANGE]
