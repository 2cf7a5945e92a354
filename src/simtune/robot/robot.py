"""What drives a robot and what films it, as small as can be."""

from typing import NamedTuple, Protocol

import numpy as np

from simtune.robot.limits import Limits


class Picture(NamedTuple):
    pixels: np.ndarray  # (H, W, 3) uint8
    time_s: float  # when it was taken, by the camera's clock


class Pulse(Protocol):
    """Needs a beat again and again while all is well: without it, it stops the robot itself."""

    def beat(self) -> None: ...

    def rest(self) -> None:
        """The robot stands still and needs no watching, until the next beat."""

    def close(self) -> None:
        """While the robot moves, this stops it."""


class Robot(Protocol):
    """Places are (D,) in the robot's own units. All methods raise RobotError where it fails."""

    axes: tuple[str, ...]  # (D,)

    def connect(self) -> None:
        """Ask, and change nothing."""

    def allow_motion(self, limits: Limits) -> Pulse:
        """Make it ready to move, with limits of its own set as well where it has any."""
        ...

    def measure(self) -> np.ndarray:
        """Where it is, (D,); RobotError where it reports an error, or has been stopped."""
        ...

    def move_to(self, target: np.ndarray) -> np.ndarray:
        """Set out for a place (D,) and return at once: the place (D,) that was really sent."""
        ...

    def stop(self) -> None: ...

    def close(self) -> None: ...


class Camera(Protocol):
    def connect(self) -> None: ...

    def take_picture(self) -> Picture:
        """A picture taken after the call. Raises RobotError where none comes."""
        ...

    def close(self) -> None: ...
