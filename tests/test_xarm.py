"""The unmodified xArm SDK, against a controller on loopback."""

import signal

import numpy as np
import pytest
from fake_xarm import TOLD_WITHIN_S, stopped_while_moving
from robot_limits import ACTIONS, HIGH, LIMITS, LOW, START, STEP_S, strange_action

from simtune.errors import InputError, RobotError
from simtune.robot.safe_arm import SafeArm
from simtune.robot.xarm import XArm

SET_STATE, MOVE_LINE, REDUCED, BOUNDARY, FENCE, REDUCED_STATE = 12, 21, 50, 52, 59, 53
SENSITIVITY, REDUCED_SPEED, GET_POSE = 37, 47, 41
# Whatever changes something; a dry run must ask for none of these.
CHANGES = {11, SET_STATE, 16, 19, *range(21, 41), REDUCED_SPEED, 48, REDUCED, BOUNDARY, 58, FENCE}


def test_asking_changes_nothing(controller, xarm, capfd):
    np.testing.assert_allclose(xarm.measure(), [300, 0, 200])
    assert not CHANGES & set(controller.registers)
    assert capfd.readouterr().out == ""  # the SDK would print


def test_it_goes_where_it_is_sent(controller, safe_xarm, xarm):
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


def test_limits_that_are_not_in_force_keep_it_still(controller, xarm, latch, monkeypatch):
    monkeypatch.setattr("simtune.robot.controller_limits._REPORTED_WITHIN_S", 0.2)
    controller.deaf = set(DEAF)
    for register, message in DEAF.items():
        with pytest.raises(RobotError, match=message):
            SafeArm(xarm, LIMITS, STEP_S, latch)
        controller.deaf.remove(register)
    assert not controller.moves


def test_a_place_outside_of_the_workspace_keeps_it_still(controller, xarm, latch):
    controller.place = np.array([300.0, 0.0, 40.0])
    with pytest.raises(RobotError, match=r"at \(300.0, 0.0, 40.0\), outside of its workspace"):
        SafeArm(xarm, LIMITS, STEP_S, latch)
    assert not CHANGES & set(controller.registers)


def test_a_tool_that_does_not_point_down_keeps_it_still(controller, xarm):
    controller.angles = np.array([2.8, 0.0, 0.0])
    with pytest.raises(RobotError, match="roll is 160° and pitch 0°"):
        xarm.measure()


def test_a_place_that_is_no_number_is_not_taken_for_the_one_before(controller, xarm):
    controller.lies[GET_POSE] = np.full(6, np.nan, "<f4").tobytes()
    with pytest.raises(RobotError, match="does not tell where it is"):
        xarm.measure()


def test_an_error_is_for_a_person_to_clear(controller, xarm, latch):
    controller.error = 31
    with pytest.raises(RobotError, match=r"error 31 \(.*[Cc]ollision.*\)"):
        SafeArm(xarm, LIMITS, STEP_S, latch)
    assert controller.error == 31
    assert not CHANGES & set(controller.registers)


def test_an_error_on_the_way_stops_it_and_latches(controller, safe_xarm, latch):
    after_s, why = stopped_while_moving(
        controller, safe_xarm, lambda: setattr(controller, "error", 22)
    )
    assert after_s < TOLD_WITHIN_S
    assert "error 22" in why
    with pytest.raises(InputError, match="error 22"):
        latch.check()


def test_a_stop_by_somebody_else_ends_the_episode(controller, safe_xarm, latch):
    _, why = stopped_while_moving(controller, safe_xarm, lambda: setattr(controller, "state", 4))
    assert "stopped or taken over: state 4" in why
    assert latch.file.exists()


def test_an_arm_that_is_dragged_away_is_stopped(controller, safe_xarm):
    def drag():
        controller.place = controller.place - np.array([0.0, 100.0, 0.0])

    after_s, why = stopped_while_moving(controller, safe_xarm, drag)
    assert after_s < TOLD_WITHIN_S
    assert "something else moves it" in why


def test_ill_actions_stop_it(controller, safe_xarm, latch):
    def act():
        safe_xarm.send(ACTIONS.target([np.nan, 0.0], START), START)

    after_s, _ = stopped_while_moving(controller, safe_xarm, act)
    assert after_s < TOLD_WITHIN_S
    assert "must be finite" in latch.file.read_text()


@pytest.fixture
def interruptible():
    """What is started in the background would ignore interrupts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("fails", [KeyboardInterrupt, ValueError])
def test_a_second_interrupt_does_not_undo_the_first(
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


def test_after_a_stop_nothing_moves_until_a_person_has_been_there(controller, xarm, latch):
    latch.close("error 31")
    with pytest.raises(InputError, match="see to it, then remove"):
        SafeArm(xarm, LIMITS, STEP_S, latch)
    assert not CHANGES & set(controller.registers)


def test_where_there_is_no_controller_it_says_so(latch):
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


def test_strange_actions_do_not_reach_the_wire(controller, safe_xarm):
    assert 1500 < fuzz_the_wire(controller, safe_xarm, 4000) < 4000


@pytest.mark.slow
def test_a_million_strange_actions_do_not_reach_the_wire(controller, safe_xarm):
    assert 400_000 < fuzz_the_wire(controller, safe_xarm, 1_000_000) < 1_000_000
