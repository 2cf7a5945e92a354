"""A process of its own that stops an xArm when the process that moves it stalls or dies.

It listens to a pipe: "a", all is well and the arm moves; "r", the arm rests. Without an "a" for
TIMEOUT_S, or where the pipe ends before an "r", it tells the controller, over a connection of its
own, to stop, and closes the latch. `python -m simtune.robot.watchdog IP LATCH` runs it.
"""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from simtune.errors import RobotError
from simtune.robot.latch import Latch
from simtune.robot.xarm_sdk import open_arm

TIMEOUT_S = 0.15  # of the 200 ms within which the order to stop must come
_READY = b"watching\n"
_MOVING, _RESTING = b"a", b"r"
_STOPPED_STATE = 4
_KEEP_STOPPING_S = 5.0
_STARTED_WITHIN_S = 15.0


class Watchdog:
    """The end of the pipe that the moving process holds; a `Pulse`."""

    def __init__(self, ip: str, latch: Latch):
        """Raises RobotError where it cannot be started."""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "simtune.robot.watchdog", ip, str(latch.file)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # what interrupts this process must not end that one
        )
        assert self.process.stdin
        assert self.process.stdout
        self._pipe, says = self.process.stdin.fileno(), self.process.stdout
        is_there = select.select([says], [], [], _STARTED_WITHIN_S)[0]
        if not is_there or says.readline() != _READY:
            self.process.kill()
            self.process.wait()
            raise RobotError(f"the watchdog could not reach the xArm at {ip}: nothing may move")

    def beat(self) -> None:
        self._tell(_MOVING)

    def rest(self) -> None:
        self._tell(_RESTING)

    def close(self) -> None:
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait()

    def _tell(self, what: bytes) -> None:
        try:
            os.write(self._pipe, what)
        except BrokenPipeError:
            raise RobotError("the watchdog is gone: it stopped the arm, or lost it") from None


def watch(ip: str, latch: Latch) -> None:
    """Listen to stdin until it ends or falls silent while the arm moves."""
    arm = open_arm(ip, reports=False)
    os.write(1, _READY)
    moving, heard_s = False, time.monotonic()
    while arm.connected:
        left_s = heard_s + TIMEOUT_S - time.monotonic() if moving else 1.0
        if select.select([0], [], [], max(left_s, 0))[0]:
            said = os.read(0, 4096)
            if not said:
                return _stop(arm, latch, "the process that moved it died") if moving else None
            moving, heard_s = said.endswith(_MOVING), time.monotonic()
        elif moving:
            return _stop(arm, latch, f"the process that moved it stalled for {TIMEOUT_S} s")
    # It can watch no longer: as it ends, so does the pipe, and the moving process stops.


def _stop(arm: Any, latch: Latch, why: str) -> None:
    deadline_s = time.monotonic() + _KEEP_STOPPING_S
    while arm.set_state(_STOPPED_STATE) != 0 or arm.state != _STOPPED_STATE:
        if time.monotonic() > deadline_s:
            why += ", and the controller did not confirm the stop"
            break
    latch.close(why)


if __name__ == "__main__":
    # An interrupt, or the end of a terminal, is no reason to stop watching.
    for ignored in (signal.SIGINT, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    watch(sys.argv[1], Latch(Path(sys.argv[2])))
