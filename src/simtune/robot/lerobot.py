"""Any robot with LeRobot's interface, and its cameras; lerobot itself is not imported.

These members of the robot are used: connect, disconnect, get_observation, send_action (which
returns the action that was actually sent), action_features and observation_features. Each number of
its action is an axis, and must be observed under the same name.
"""

import importlib
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError, RobotError, UnknownName, blame
from simtune.robot.limits import Limits
from simtune.robot.robot import Picture


class LeRobot:
    """A `Robot` that wraps one with LeRobot's interface, and uses its units."""

    def __init__(self, robot: Any, axes: Sequence[str]):
        """Raises UnknownName, InputError if `axes` are not those of the robot's actions."""
        known = tuple(robot.action_features)
        for axis in axes:
            if axis not in known:
                raise UnknownName("axis", axis, "the robot's action_features", known)
        missing = [name for name in known if name not in axes]
        if missing:
            raise InputError(f"the workspace lacks {missing[0]}, which the robot's actions have")
        self.axes, self.robot = tuple(axes), robot
        self._latest: np.ndarray | None = None  # place that was measured

    def connect(self) -> None:
        with blame("the robot does not connect", RobotError):
            self.robot.connect()

    def allow_motion(self, limits: Limits) -> "Unwatched":
        return Unwatched()

    def measure(self) -> np.ndarray:
        with blame("the robot does not tell where it is", RobotError):
            seen = self.robot.get_observation()
            place = np.array([float(seen[axis]) for axis in self.axes])
        if np.isfinite(place).all():
            self._latest = place
        return place

    def move_to(self, target: np.ndarray) -> np.ndarray:
        with blame("the robot does not move", RobotError):
            asked = {axis: float(v) for axis, v in zip(self.axes, target, strict=True)}
            sent = self.robot.send_action(asked)
            return np.array([float(sent[axis]) for axis in self.axes])

    def stop(self) -> None:
        """Send the robot to its current position, since the interface cannot stop it.

        To the latest one that is known, if it does not tell: an observation includes pictures, and
        a camera may be what failed.
        """
        with suppress(RobotError):
            self.measure()
        if self._latest is None:
            raise RobotError("the robot cannot be stopped: it has not reported its position")
        self.move_to(self._latest)

    def close(self) -> None:
        with blame("the robot does not disconnect", RobotError):
            self.robot.disconnect()


class Unwatched:
    """A `Pulse` without a watchdog: LeRobot's robots accept one connection, which is in use."""

    def beat(self) -> None: ...

    def rest(self) -> None: ...

    def close(self) -> None: ...


class LeRobotCamera:
    """A `Camera` that belongs to the robot; it has no clock, so times are the host's."""

    def __init__(self, robot: Any, name: str | None):
        """`name`: a key of observation_features; None: the only camera. Raises InputError."""
        known = [k for k, shape in robot.observation_features.items() if isinstance(shape, tuple)]
        if name is None and len(known) != 1:
            raise InputError(f"give the camera's name: the robot has {', '.join(known) or 'none'}")
        if name is not None and name not in known:
            raise UnknownName("camera", name, "the robot's observation_features", known)
        self._robot, self._name = robot, name or known[0]

    def connect(self) -> None:
        """Nothing to do: the robot connects it."""

    def take_picture(self) -> Picture:
        with blame("the robot does not show a picture", RobotError):
            pixels = np.asarray(self._robot.get_observation()[self._name])
            time_s = time.time()
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
            raise RobotError(
                f"camera {self._name} must give uint8 (H, W, 3), got {pixels.dtype} {pixels.shape}"
            )
        return Picture(pixels, time_s)

    def close(self) -> None:
        """Nothing to do: the robot closes it."""


def make_lerobot(address: str, beside: Path) -> Any:
    """The robot that MODULE:FUNCTION returns; the module may be in the folder `beside`.

    Raises InputError.
    """
    module, _, function = address.partition(":")
    if not (module and function):
        raise InputError(f"address must be MODULE:FUNCTION, which makes a robot, got {address}")
    sys.path.insert(0, str(beside.resolve()))
    try:
        with blame(f"{address} makes no robot"):
            robot = getattr(importlib.import_module(module), function)()
    finally:
        sys.path.pop(0)
    if not hasattr(robot, "action_features"):
        raise InputError(f"{address} makes no robot of LeRobot's interface, but {robot!r:.60}")
    return robot
