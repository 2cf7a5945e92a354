"""Nothing that a policy may come up with gets a robot out of its limits."""

import numpy as np
import pytest
from robot_limits import ACTIONS, HIGH, LIMITS, LOW, START, STEP_S, strange_action

from simtune.errors import InputError, RobotError
from simtune.robot.latch import Latch
from simtune.robot.limits import Limits


def through(action, measured: np.ndarray) -> np.ndarray | None:
    """What would be sent, as the wire has it; None where the action was refused."""
    try:
        target = LIMITS.cut(ACTIONS.target(action, measured), measured, STEP_S)
    except RobotError:
        return None
    return target.astype(np.float32).astype(float)


def fuzz(num: int) -> int:
    """How many of so many actions were sent; all of them within the limits."""
    rng, sent = np.random.default_rng(0), 0
    measured = START
    for _ in range(num):
        target = through(strange_action(rng), measured)
        if target is None:
            continue
        sent += 1
        assert (target >= LOW).all()
        assert (target <= HIGH).all()
        assert np.linalg.norm(target - measured) <= LIMITS.speed * STEP_S
        # On it goes, from anywhere that a robot may be.
        measured = target if rng.random() < 0.9 else rng.uniform(LOW, HIGH)
    return sent


def test_strange_actions_are_refused_or_cut():
    assert 1500 < fuzz(4000) < 4000


def test_a_robot_whose_step_is_shorter_than_the_margin_goes_towards_its_target():
    slow = Limits(low=np.zeros(1), high=np.ones(1), speed=0.005, tolerance=0.01)
    (there,) = slow.cut(np.array([0.9]), np.array([0.5]), 0.1)
    assert 0.5 < there <= 0.5 + 0.005 * 0.1


@pytest.mark.slow
def test_a_million_strange_actions_are_refused_or_cut():
    assert 400_000 < fuzz(1_000_000) < 1_000_000


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([np.nan, 0.0], "must be finite"),
        ([np.inf, 0.0], "must be finite"),
        ([0.0], "must be 2 numbers"),
        ([[0.0, 0.0]], "must be 2 numbers"),
        (["left", "right"], "must be 2 numbers"),
        ([True, False], "must be 2 numbers"),
    ],
)
def test_actions_that_mean_nothing_are_refused(action, message):
    with pytest.raises(RobotError, match=message):
        ACTIONS.target(action, START)


def test_an_action_displaces_from_where_the_robot_is():
    measured = np.array([310.0, 20.0, 207.0])
    target = ACTIONS.target([1.0, -0.5], measured)
    np.testing.assert_allclose(target, [310 - 12.5, 20 - 25, 200])  # nothing moves z: the start's
    np.testing.assert_allclose(ACTIONS.action(target, measured), [1.0, -0.5])
    np.testing.assert_allclose(ACTIONS.target([9.0, -9.0], measured), [285, -5, 200])


def test_what_is_too_far_is_cut_along_the_way():
    target = LIMITS.cut(START + np.array([60.0, 80.0, 0.0]), START, STEP_S)
    np.testing.assert_allclose(target, START + np.array([18.0, 24.0, 0.0]), atol=1e-2)
    edge = LIMITS.cut(np.array([600.0, 0.0, 200.0]), np.array([495.0, 0.0, 200.0]), STEP_S)
    np.testing.assert_allclose(edge, [500, 0, 200], atol=1e-2)


def test_a_robot_outside_of_its_workspace_is_refused():
    LIMITS.check(LOW - 4.9)
    for place in (LOW - 5.1, HIGH + 5.1, np.array([np.nan, 0, 200])):
        with pytest.raises(RobotError, match=r"outside of its workspace|finite numbers"):
            LIMITS.check(place)


def test_a_robot_that_is_not_on_its_way_is_noticed():
    LIMITS.check_follows(START, START + np.array([34.9, 0.0, 0.0]), STEP_S)
    with pytest.raises(RobotError, match=r"35\.1 away from where it was sent"):
        LIMITS.check_follows(START, START + np.array([35.1, 0.0, 0.0]), STEP_S)


def test_a_stop_lasts_until_a_person_ends_it(tmp_path):
    latch = Latch(tmp_path / "arm.toml.stopped")
    latch.check()
    latch.close("error 31")
    latch.close("what came of it")
    for _ in range(2):
        with pytest.raises(InputError, match=r"error 31\): see to it, then remove .*stopped"):
            Latch(latch.file).check()
    latch.file.unlink()
    latch.check()
