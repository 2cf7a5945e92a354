"""Limits of a robot's position and speed."""

from dataclasses import dataclass

import numpy as np

from simtune.errors import RobotError

# Distance from the limits, since positions are sent as float32, which may round them up
_LIMIT_MARGIN = 1e-3


@dataclass(frozen=True, kw_only=True)
class Limits:
    """A box and a maximum speed, in the robot's units.

    Targets are clipped to the limits; a robot measured outside the box is stopped.
    """

    low: np.ndarray  # (D,)
    high: np.ndarray  # (D,)
    speed: float  # units/s, along the path
    tolerance: float  # how far outside the box a robot may be measured, e.g. when sent to its edge

    def cut(self, target: np.ndarray, measured: np.ndarray, step_s: float) -> np.ndarray:
        """The (D,) position towards `target` that is within the box and reachable in `step_s`.

        Raises RobotError for positions that are not finite numbers (D,).
        """
        target, measured = _place(target, self.low), _place(measured, self.low)
        way = target - measured
        longest = self.speed * step_s
        longest -= min(_LIMIT_MARGIN, longest / 10)  # a slow robot's step may be shorter than that
        distance = float(np.linalg.norm(way))
        if distance > longest:
            target = measured + way * (longest / distance)
        return np.clip(target, self.low + _LIMIT_MARGIN, self.high - _LIMIT_MARGIN)

    def check(self, measured: np.ndarray) -> None:
        """Raises RobotError if a measured position (D,) is outside the box."""
        measured = _place(measured, self.low)
        beyond = np.maximum(self.low - measured, measured - self.high)
        if (beyond > self.tolerance).any():
            raise RobotError(
                f"the robot is at {_shown(measured)}, outside of its workspace from "
                f"{_shown(self.low)} to {_shown(self.high)}: move it inside by hand"
            )

    def check_follows(self, sent: np.ndarray, measured: np.ndarray, step_s: float) -> None:
        """Raises RobotError if the robot is farther from its target than one step's distance."""
        away = float(np.linalg.norm(measured - sent))
        if not away <= self.speed * step_s + self.tolerance:
            raise RobotError(
                f"the robot is at {_shown(measured)}, {away:.1f} away from where it was sent: "
                "something else moves it"
            )


def _place(given: np.ndarray, like: np.ndarray) -> np.ndarray:
    given = np.asarray(given, float)
    if given.shape != like.shape or not np.isfinite(given).all():
        raise RobotError(f"a place must be {len(like)} finite numbers, got {given.tolist()}")
    return given


def _shown(place: np.ndarray) -> str:
    return f"({', '.join(f'{value:.1f}' for value in place)})"
