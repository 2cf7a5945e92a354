"""Any robot with LeRobot's interface, and its own cameras; lerobot itself is not imported.

Of the robot are used: connect, disconnect, get_observation, send_action (which returns the action
that was really sent), action_features and observation_features. Each of its action's numbers is an
axis, and has to be observed under the same name.
"""

import importlib
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError, RobotError, UnknownName, blame
from simtune.robot.limits import Limits
from simtune.robot.robot import Picture


class LeRobot:
    """A `Robot` in the units of the one that it hands everything on to."""

    def __init__(self, robot: Any, axes: Sequence[str]):
        """Raises UnknownName, InputError where `axes` are not what it acts along."""
        known = tuple(robot.action_features)
        for axis in axes:
            if axis not in known:
                raise UnknownName("axis", axis, "the robot's action_features", known)
        missing = [name for name in known if name not in axes]
        if missing:
            raise InputError(f"the workspace lacks {missing[0]}, which the robot's actions have")
        self.axes, self.robot = tuple(axes), robot

    def connect(self) -> None:
        with blame("the robot does not connect", RobotError):
            self.robot.connect()

    def allow_motion(self, limits: Limits) -> "Unwatched":
        return Unwatched()

    def measure(self) -> np.ndarray:
        with blame("the robot does not tell where it is", RobotError):
            seen = self.robot.get_observation()
            return np.array([float(seen[axis]) for axis in self.axes])

    def move_to(self, target: np.ndarray) -> np.ndarray:
        with blame("the robot does not move", RobotError):
            asked = {axis: float(v) for axis, v in zip(self.axes, target, strict=True)}
            sent = self.robot.send_action(asked)
            return np.array([float(sent[axis]) for axis in self.axes])

    def stop(self) -> None:
        """There is no such thing in the interface: it is sent to where it is."""
        place = self.measure()
        if not np.isfinite(place).all():
            raise RobotError(f"the robot cannot be stopped: it says that it is at {place.tolist()}")
        self.move_to(place)

    def close(self) -> None:
        with blame("the robot does not disconnect", RobotError):
            self.robot.disconnect()


class Unwatched:
    """A `Pulse` without a listener: LeRobot's robots take one connection, and it is in use."""

    def beat(self) -> None: ...

    def rest(self) -> None: ...

    def close(self) -> None: ...


class LeRobotCamera:
    """A `Camera` of the robot's own; it has no clock, so its times are the host's."""

    def __init__(self, robot: Any, name: str | None):
        """`name`: as in observation_features; None: the only one. Raises InputError."""
        known = [k for k, shape in robot.observation_features.items() if isinstance(shape, tuple)]
        if name is None and len(known) != 1:
            raise InputError(f"give the camera's name: the robot has {', '.join(known) or 'none'}")
        if name is not None and name not in known:
            raise UnknownName("camera", name, "the robot's observation_features", known)
        self._robot, self._name = robot, name or known[0]

    def connect(self) -> None:
        """With the robot."""

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
        """With the robot."""


def make_lerobot(address: str, beside: Path) -> Any:
    """What MODULE:FUNCTION returns; the module may lie in a folder. Raises InputError."""
    module, _, function = address.partition(":")
    if not (module and function):
        raise InputError(f"address must be MODULE:FUNCTION, which makes a robot, got {address}")
    sys.path.insert(0, str(beside.resolve()))
    try:
        robot = getattr(importlib.import_module(module), function)()
    except Exception as error:  # whatever the user's own code raises
        raise InputError(f"{address} makes no robot: {error}") from error
    finally:
        sys.path.pop(0)
    if not hasattr(robot, "action_features"):
        raise InputError(f"{address} makes no robot of LeRobot's interface, but {robot!r:.60}")
    return robot
