"""The watchdog: the arm is told to stop whatever becomes of the process that moves it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fake_xarm import TOLD_WITHIN_S, stopped_while_moving
from robot_limits import START

from simtune.robot.latch import Latch


def test_a_policy_that_takes_too_long_is_stopped_by_the_watchdog(controller, safe_xarm, latch):
    after_s, why = stopped_while_moving(controller, safe_xarm, lambda: time.sleep(0.5))
    assert after_s < TOLD_WITHIN_S
    assert "stopped or taken over" in why
    assert "stalled" in latch.file.read_text()


def test_without_its_watchdog_it_stops(controller, safe_xarm):
    after_s, why = stopped_while_moving(controller, safe_xarm, safe_xarm._pulse._process.kill)
    assert after_s < TOLD_WITHIN_S
    assert "watchdog is gone" in why


def test_a_resting_arm_needs_no_heartbeat(controller, safe_xarm, latch):
    safe_xarm.go_to(np.array([310.0, 0.0, 200.0]))
    controller.stops.clear()
    time.sleep(0.4)
    safe_xarm.go_to(START)
    assert not controller.stops
    assert not latch.file.exists()


def kill(controller, latch: Latch, how: signal.Signals, after_s: float) -> float:
    """Start a process that moves the arm, and end it on the way; seconds until it was stopped."""
    script = Path(__file__).with_name("move_until_killed.py")
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
        deadline_s = killed_s + 5
        while not (controller.stops and latch.file.exists()) and time.monotonic() < deadline_s:
            time.sleep(0.005)
        assert controller.stops, "it was never stopped"
        return controller.stops[0] - killed_s
    finally:
        process.kill()
        process.wait()
        latch.file.unlink(missing_ok=True)


def kills(controller, latch, num: int) -> np.ndarray:
    rng, took_s = np.random.default_rng(0), []
    for i in range(num):
        how = (signal.SIGKILL, signal.SIGSTOP, signal.SIGABRT)[i % 3]
        took_s.append(kill(controller, latch, how, rng.uniform(0, 0.7)))
    return np.array(took_s)


def test_it_is_told_to_stop_when_the_policy_dies_or_stalls(controller, latch):
    assert (kills(controller, latch, 3) < TOLD_WITHIN_S).all()


@pytest.mark.slow
def test_it_is_told_to_stop_each_time(controller, latch):
    took_s = kills(controller, latch, 50)
    middle_ms, longest_ms = 1000 * np.median(took_s), 1000 * took_s.max()
    print(f"told to stop after {middle_ms:.0f} ms, at most {longest_ms:.0f} ms")
    assert (took_s < TOLD_WITHIN_S).all()
