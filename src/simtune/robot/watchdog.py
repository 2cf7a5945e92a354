"""A separate process that stops an xArm if the process that moves it stalls or dies.

It listens to a pipe: "a" means that all is well and the arm moves, "r" that the arm rests. If no
"a" comes for TIMEOUT_S while the arm moves, or the pipe ends before an "r", it tells the controller
to stop, over its own connection, and closes the latch. `python -m simtune.robot.watchdog IP LATCH`
runs it.
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

TIMEOUT_S = 0.15  # the order to stop must come within 200 ms
_READY = b"watching\n"
_MOVING, _RESTING = b"a", b"r"
_STOPPED_STATE = 4
_KEEP_STOPPING_S = 5.0
_STARTED_WITHIN_S = 15.0


class Watchdog:
    """The moving process's end of the pipe; a `Pulse`."""

    def __init__(self, ip: str, latch: Latch):
        """Start the process. Raises RobotError if that fails."""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "simtune.robot.watchdog", ip, str(latch.file)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # an interrupt of this process must not end the watchdog
        )
        assert self.process.stdin
        assert self.process.stdout
        self._pipe, output = self.process.stdin.fileno(), self.process.stdout
        has_answer = select.select([output], [], [], _STARTED_WITHIN_S)[0]
        if not has_answer or output.readline() != _READY:
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
    """Listen to stdin until it ends, or is silent for too long while the arm moves."""
    arm = open_arm(ip, reports=False)
    os.write(1, _READY)
    moving, heard_s = False, time.monotonic()
    while arm.connected:
        left_s = heard_s + TIMEOUT_S - time.monotonic() if moving else 1.0
        if select.select([0], [], [], max(left_s, 0))[0]:
            message = os.read(0, 4096)
            if not message:
                return _stop(arm, latch, "the process that moved it died") if moving else None
            moving, heard_s = message.endswith(_MOVING), time.monotonic()
        elif moving:
            return _stop(arm, latch, f"the process that moved it stalled for {TIMEOUT_S} s")
    # The connection is lost. As this process ends, the pipe breaks, and the moving process stops.


def _stop(arm: Any, latch: Latch, why: str) -> None:
    deadline_s = time.monotonic() + _KEEP_STOPPING_S
    while arm.set_state(_STOPPED_STATE) != 0 or arm.state != _STOPPED_STATE:
        if time.monotonic() > deadline_s:
            why += ", and the controller did not confirm the stop"
            break
    latch.close(why)


if __name__ == "__main__":
    # An interrupt, or a closed terminal, must not end the watchdog.
    for ignored in (signal.SIGINT, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    watch(sys.argv[1], Latch(Path(sys.argv[2])))
