"""The unmodified xArm SDK, against a controller on loopback."""

import signal
from contextlib import closing

import numpy as np
import pytest
from fake_xarm import stopped_while_moving
from robot_limits import ACTIONS, HIGH, LIMITS, LOW, START, STEP_S, strange_action

from simtune.errors import InputError, RobotError
from simtune.robot.safe_arm import SafeArm
from simtune.robot.xarm import XArm

SET_STATE, MOVE_LINE, REDUCED, BOUNDARY, FENCE, REDUCED_STATE = 12, 21, 50, 52, 59, 53
SENSITIVITY, REDUCED_SPEED, GET_POSE = 37, 47, 41
# Whatever changes something; a dry run must ask for none of these.
CHANGES = {11, SET_STATE, 16, 19, *range(21, 41), REDUCED_SPEED, 48, REDUCED, BOUNDARY, 58, FENCE}


def test_measuring_an_arm_changes_nothing_in_its_controller(controller, xarm, capfd):
    np.testing.assert_allclose(xarm.measure(), [300, 0, 200])
    assert not CHANGES & set(controller.registers)
    assert capfd.readouterr().out == ""  # the SDK would print


def test_an_arm_goes_where_it_is_sent_in_lines_within_its_limits(controller, safe_xarm, xarm):
    safe_xarm.go_to(np.array([350.0, 20.0, 210.0]))
    np.testing.assert_allclose(xarm.measure(), [350, 20, 210], atol=3)
    for _, line in controller.moves:
        assert (line[:3] >= LOW).all()
        assert (line[:3] <= HIGH).all()
        np.testing.assert_allclose(line[3:6], [np.pi, 0, 0], atol=1e-6)
        np.testing.assert_allclose(line[6:8], [100, 1000])
    assert controller.mode == 7


def test_the_controllers_own_limits_are_set_before_anything_moves(controller, safe_xarm):
    assert (controller.is_reduced, controller.is_fenced, controller.sensitivity) == (1, 1, 4)
    assert controller.reduced_speed == LIMITS.speed
    assert controller.boundary == [505, 195, 205, -206, 406, 95]
    assert not controller.moves


DEAF = {
    REDUCED: "reduced mode is 0 after 1 was set",
    BOUNDARY: "TCP boundary is .*9999.* after",
    REDUCED_SPEED: "maximum speed is 1000.0 after 100.0 was set",
    FENCE: "fence is 0 after 1 was set",
    SENSITIVITY: "collision sensitivity is 3 after 4 was set",
}


def test_an_arm_whose_limits_are_not_in_force_is_not_moved(controller, latch, monkeypatch):
    monkeypatch.setattr("simtune.robot.controller_limits.REPORTED_WITHIN_S", 0.2)
    settings = {"acceleration": 1000.0, "collision_sensitivity": 4}
    with closing(XArm(controller.ip, **settings, latch=latch)) as xarm:
        xarm.connect()
        controller.deaf = set(DEAF)
        for register, message in DEAF.items():
            with pytest.raises(RobotError, match=message):
                SafeArm(xarm, LIMITS, STEP_S, latch)
            controller.deaf.remove(register)
    assert not controller.moves


def test_an_arm_outside_of_its_workspace_is_not_moved(controller, xarm, latch):
    controller.place = np.array([300.0, 0.0, 40.0])
    with pytest.raises(RobotError, match=r"at \(300.0, 0.0, 40.0\), outside of its workspace"):
        SafeArm(xarm, LIMITS, STEP_S, latch)
    assert not CHANGES & set(controller.registers)


def test_measuring_fails_where_the_tool_does_not_point_down(controller, xarm):
    controller.angles = np.array([2.8, 0.0, 0.0])
    with pytest.raises(RobotError, match="roll is 160° and pitch 0°"):
        xarm.measure()


def test_measuring_fails_where_the_controller_tells_a_nan_place(controller, xarm):
    controller.lies[GET_POSE] = np.full(6, np.nan, "<f4").tobytes()
    with pytest.raises(RobotError, match="does not tell where it is"):
        xarm.measure()


def test_an_arm_with_an_error_is_refused_and_the_error_not_cleared(controller, xarm, latch):
    controller.error = 31
    with pytest.raises(RobotError, match=r"error 31 \(.*[Cc]ollision.*\)"):
        SafeArm(xarm, LIMITS, STEP_S, latch)
    assert controller.error == 31
    assert not CHANGES & set(controller.registers)


def test_an_error_during_a_motion_stops_the_arm_and_closes_the_latch(controller, safe_xarm, latch):
    why = stopped_while_moving(controller, safe_xarm, lambda: setattr(controller, "error", 22))
    assert "error 22" in why
    with pytest.raises(InputError, match="error 22"):
        latch.check()


def test_a_stop_by_somebody_else_ends_the_motion_and_closes_the_latch(controller, safe_xarm, latch):
    why = stopped_while_moving(controller, safe_xarm, lambda: setattr(controller, "state", 4))
    assert "stopped or taken over: state 4" in why
    assert latch.file.exists()


def test_an_arm_that_something_else_moves_is_stopped(controller, safe_xarm):
    def drag():
        controller.place = controller.place - np.array([0.0, 100.0, 0.0])

    why = stopped_while_moving(controller, safe_xarm, drag)
    assert "something else moves it" in why


def test_an_action_of_nan_stops_the_arm_and_closes_the_latch(controller, safe_xarm, latch):
    def act():
        safe_xarm.send(ACTIONS.target([np.nan, 0.0], START), START)

    stopped_while_moving(controller, safe_xarm, act)
    assert "must be finite" in latch.file.read_text()


@pytest.fixture
def interruptible():
    """What is started in the background would ignore interrupts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("fails", [KeyboardInterrupt, ValueError])
def test_a_second_interrupt_during_a_stop_is_ignored_and_the_arm_stopped(
    controller, safe_xarm, xarm, latch, monkeypatch, fails
):
    def stop():
        signal.raise_signal(signal.SIGINT)  # the impatient second one, which is ignored
        raise fails

    monkeypatch.setattr(xarm, "stop", stop)

    def move():
        with safe_xarm.moving():
            safe_xarm.send(START, safe_xarm.measure())
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        move()
    assert latch.file.exists()
    assert controller.stops, "the watchdog stopped it all the same"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_closed_latch_keeps_the_arm_still(controller, xarm, latch):
    latch.close("error 31")
    with pytest.raises(InputError, match="see to it, then remove"):
        SafeArm(xarm, LIMITS, STEP_S, latch)
    assert not CHANGES & set(controller.registers)


def test_connecting_without_a_controller_names_the_address(latch):
    robot = XArm("127.0.0.1", acceleration=1000.0, collision_sensitivity=3, latch=latch)
    with pytest.raises(RobotError, match=r"no xArm answers at 127\.0\.0\.1"):
        robot.connect()


# --- whatever a policy does ---------------------------------------------------------------


def fuzz_the_wire(controller, safe_xarm, num: int) -> int:
    """So many strange actions down to the wire; how many were sent, all of them within limits."""
    rng, sent = np.random.default_rng(1), 0
    with safe_xarm.moving():
        for _ in range(num):
            controller.moves = []
            measured = safe_xarm.measure()
            try:
                target = ACTIONS.target(strange_action(rng), measured)
            except RobotError:
                assert not controller.moves
                continue
            safe_xarm.send(target, measured)
            sent += 1
            ((_, line),) = controller.moves
            assert np.isfinite(line).all()
            assert (line[:3] >= LOW.astype(np.float32)).all()
            assert (line[:3] <= HIGH.astype(np.float32)).all()
            assert np.linalg.norm(line[:3] - measured) <= LIMITS.speed * STEP_S
            assert line[6] <= LIMITS.speed
    return sent


@pytest.mark.thorough
def test_strange_actions_reach_the_controller_within_limits_or_not_at_all(controller, safe_xarm):
    assert 375 < fuzz_the_wire(controller, safe_xarm, 1000) < 1000


@pytest.mark.slow
def test_a_million_strange_actions_reach_the_controller_within_limits_or_not_at_all(
    controller, safe_xarm
):
    assert 400_000 < fuzz_the_wire(controller, safe_xarm, 1_000_000) < 1_000_000
