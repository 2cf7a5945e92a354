"""The only code that moves a robot: each step is measured, cut to the limits, and watched."""

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from simtune.errors import RobotError
from simtune.robot.latch import Latch
from simtune.robot.limits import Limits
from simtune.robot.robot import Pulse, Robot
from simtune.robot.signals import uninterrupted

_LOOK_EVERY_S = 0.025
_ARRIVED_SHARE = 0.5  # of the tolerance: so near, the robot has arrived


class SafeArm:
    """A robot within limits. Any error while it moves stops it and closes the latch."""

    def __init__(self, robot: Robot, limits: Limits, step_s: float, latch: Latch):
        """Raises InputError if the latch is closed, RobotError if the robot may not move."""
        latch.check()
        self._robot, self._limits, self._step_s, self._latch = robot, limits, step_s, latch
        self._sent: np.ndarray | None = None  # (D,) latest position sent, while it moves
        limits.check(robot.measure())
        self._pulse: Pulse = robot.allow_motion(limits)

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Context in which the robot may move; afterwards it rests."""
        self._sent = None
        try:
            yield
        except BaseException as error:
            with uninterrupted():
                self._stop(str(error) or type(error).__name__)
            raise
        self._pulse.rest()

    def _stop(self, why: str) -> None:
        """Stop the robot, close the latch, end the pulse; each is tried even if another fails."""
        try:
            with suppress(Exception):  # drivers may raise anything
                self._robot.stop()
        finally:
            try:
                self._latch.close(why)
            finally:
                self._pulse.close()  # the watchdog stops the robot as well

    def measure(self) -> np.ndarray:
        """The position (D,); tells the watchdog that all is well. Raises RobotError if not."""
        measured = self._robot.measure()
        self._limits.check(measured)
        if self._sent is not None:
            self._limits.check_follows(self._sent, measured, self._step_s)
        self._pulse.beat()
        return measured

    def send(self, target: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Start moving towards `target` (D,), within the limits; returns the position sent (D,)."""
        self._sent = self._robot.move_to(self._limits.cut(target, measured, self._step_s))
        return self._sent

    def wait_until(self, time_s: float) -> None:
        """Watch the robot until `time_s` of the monotonic clock."""
        while (left_s := time_s - time.monotonic()) > 0:
            self.measure()
            time.sleep(min(left_s, _LOOK_EVERY_S))

    def go_to(self, place: np.ndarray) -> None:
        """Move step by step to a position (D,), and rest there."""
        with self.moving():
            measured = self.measure()
            way = float(np.linalg.norm(place - measured))
            deadline_s = time.monotonic() + 5 + 3 * way / self._limits.speed
            while np.abs(place - measured).max() > _ARRIVED_SHARE * self._limits.tolerance:
                if time.monotonic() > deadline_s:
                    raise RobotError(f"the robot does not get to {place.tolist()}")
                self.send(place, measured)
                self.wait_until(time.monotonic() + self._step_s)
                measured = self.measure()

    def close(self) -> None:
        self._pulse.close()
