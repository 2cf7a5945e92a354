"""The watchdog: the arm is told to stop whatever becomes of the process that moves it."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import closing

import numpy as np
import pytest
from fake_xarm import stopped_while_moving
from places import SUPPORT
from robot_limits import LIMITS, START, STEP_S

from simtune.robot.latch import Latch
from simtune.robot.safe_arm import SafeArm
from simtune.robot.watchdog import TIMEOUT_S, Watchdog


def test_the_watchdog_stops_the_arm_while_its_policy_stalls(controller, safe_xarm, latch):
    def stall():
        until_s = time.monotonic() + 10
        while not latch.file.exists() and time.monotonic() < until_s:
            time.sleep(0.005)

    why = stopped_while_moving(controller, safe_xarm, stall)
    assert "stopped or taken over" in why
    assert f"stalled for {TIMEOUT_S} s" in latch.file.read_text()


def test_the_arm_stops_where_its_watchdog_is_gone(controller, xarm, latch, monkeypatch):
    watchdogs: list[Watchdog] = []

    def allow_motion(*given, allow=xarm.allow_motion) -> Watchdog:
        watchdogs.append(allow(*given))
        return watchdogs[-1]

    def end():
        watchdogs[0].process.kill()
        watchdogs[0].process.wait()

    monkeypatch.setattr(xarm, "allow_motion", allow_motion)
    with closing(SafeArm(xarm, LIMITS, STEP_S, latch)) as arm:
        why = stopped_while_moving(controller, arm, end)
    assert "watchdog is gone" in why


def test_the_watchdog_leaves_a_resting_arm_alone(controller, safe_xarm, latch):
    safe_xarm.go_to(np.array([310.0, 0.0, 200.0]))
    controller.stops.clear()
    time.sleep(2 * TIMEOUT_S)
    safe_xarm.go_to(START)
    assert not controller.stops
    assert not latch.file.exists()


def test_the_watchdog_waits_for_less_than_the_200_ms_it_promises():
    assert TIMEOUT_S < 0.2


def written(latch: Latch) -> str:
    """Why it is closed; the file is there a moment before its text."""
    return latch.file.read_text() if latch.file.exists() else ""


def kill(controller, latch: Latch, how: signal.Signals, after_s: float) -> float:
    """Start a process that moves the arm, and end it on the way; seconds until it was stopped."""
    script = SUPPORT / "move_until_killed.py"
    command = [sys.executable, str(script), controller.ip, str(latch.file)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert process.stdout
        assert process.stdout.readline() == b"moving\n"
        controller.moves.clear()
        while not controller.moves:
            time.sleep(0.005)
        time.sleep(after_s)
        controller.stops.clear()
        killed_s = time.monotonic()
        os.kill(process.pid, how)
        deadline_s = killed_s + 30
        while not (controller.stops and written(latch)) and time.monotonic() < deadline_s:
            time.sleep(0.005)
        assert controller.stops, "it was never stopped"
        assert re.search("died|stalled", written(latch))
        return controller.stops[0] - killed_s
    finally:
        process.kill()
        process.wait()
        latch.file.unlink(missing_ok=True)


HOW = {"killed": signal.SIGKILL, "frozen": signal.SIGSTOP, "aborted": signal.SIGABRT}


@pytest.mark.parametrize("how", ["killed", "frozen"])
def test_the_arm_is_stopped_when_the_process_that_moves_it_is(how, controller, latch):
    kill(controller, latch, HOW[how], after_s=0.1)


@pytest.mark.slow
def test_the_arm_is_stopped_each_of_50_times_its_process_ends_or_freezes(controller, latch):
    rng, signals = np.random.default_rng(0), [*HOW.values()]
    took_s = [kill(controller, latch, signals[i % 3], rng.uniform(0, 0.7)) for i in range(50)]
    middle_ms, longest_ms = 1000 * np.median(took_s), 1000 * max(took_s)
    print(f"told to stop after {middle_ms:.0f} ms, at most {longest_ms:.0f} ms")
