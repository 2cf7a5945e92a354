"""Minimal interfaces of robots and cameras."""

from typing import NamedTuple, Protocol

import numpy as np

from simtune.robot.limits import Limits


class Picture(NamedTuple):
    pixels: np.ndarray  # (H, W, 3) uint8
    time_s: float  # time when it was taken, by the camera's clock


class Pulse(Protocol):
    """A watchdog's input: without regular beats while the robot moves, it stops the robot."""

    def beat(self) -> None: ...

    def rest(self) -> None:
        """The robot rests: no beats are needed until the next one."""

    def close(self) -> None:
        """End; this stops a robot that moves."""


class Robot(Protocol):
    """A robot. Positions are (D,) in its own units. All methods raise RobotError on failure."""

    axes: tuple[str, ...]  # (D,)

    def connect(self) -> None:
        """Connect for reading only; nothing is changed."""

    def allow_motion(self, limits: Limits) -> Pulse:
        """Get ready to move; sets the limits in the robot's controller too, if it can."""
        ...

    def measure(self) -> np.ndarray:
        """The position (D,). RobotError if the robot reports an error or has been stopped."""
        ...

    def move_to(self, target: np.ndarray) -> np.ndarray:
        """Start moving to a position (D,); returns at once the position (D,) actually sent."""
        ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


class Camera(Protocol):
    def connect(self) -> None: ...

    def take_picture(self) -> Picture:
        """A picture taken after the call. Raises RobotError if none comes."""
        ...

    def close(self) -> None: ...
