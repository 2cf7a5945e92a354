"""Content of a robot's file, for `--real xarm` and `--real lerobot`."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from simtune.errors import InputError, UnknownName

Driver = Literal["xarm", "lerobot"]

FASTEST_MM_S = 250.0  # reduced speed by ISO 10218-1
FASTEST_MM_S2 = 2000.0  # reaches that speed within 16 mm
FARTHEST_MM = 1000.0  # beyond the reach of any xArm from its base
_MOST_TOLERANCE = 0.1  # share of the narrowest axis: a larger one would defeat the workspace


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """The camera: a RealSense for an xArm, or a camera of a robot with LeRobot's interface."""

    name: str | None  # RealSense: serial number; robot: its camera's name; None: the only one
    playback: Path | None  # a RealSense's recording, used instead of the camera
    recorded_px: int  # side of the stored pictures


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """A robot in its own coordinates: mm in an xArm's base frame, or a LeRobot robot's units."""

    file: Path
    driver: Driver
    address: str  # xArm: its controller's IP address; lerobot: MODULE:FUNCTION that makes it
    moved: tuple[str, ...]  # (A,) the axis that each of the task's actions moves, such as "-y"
    step: float  # displacement by an action of 1, units
    workspace: dict[str, tuple[float, float]]  # lowest and highest position on each of the D axes
    start: tuple[float, ...]  # (D,) start of episodes
    speed: float  # maximum, units/s
    tolerance: float  # how far outside the workspace a measured position may be, units
    acceleration: float  # units/s²
    collision_sensitivity: int  # of an xArm, from 1 to 5: 5 stops at the slightest touch
    ask: bool  # whether a person must confirm before each episode
    camera: CameraConfig

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.workspace)

    @property
    def latch(self) -> Path:
        """The file that exists after the robot was stopped."""
        return self.file.with_name(f"{self.file.name}.stopped")

    def check(self) -> None:
        """Raises InputError for invalid values."""
        for axis in self.moved:
            if axis.removeprefix("-") not in self.workspace:
                raise UnknownName("axis", axis, f"the workspace of {self.file}", self.axes)
        if problem := next(self._problems(), None):
            raise InputError(f"{self.file}: {problem}")

    def _problems(self) -> Iterator[str]:
        if len({axis.removeprefix("-") for axis in self.moved}) < len(self.moved):
            yield f"two actions move one axis: {', '.join(self.moved)}"
        for (axis, (low, high)), start in zip(self.workspace.items(), self.start, strict=True):
            if not low <= start <= high:
                yield (
                    f"the start {axis} = {start:g} lies outside of the workspace, "
                    f"{low:g} to {high:g}"
                )
        largest = _MOST_TOLERANCE * min(high - low for low, high in self.workspace.values())
        if not self.tolerance <= largest:
            yield (
                "tolerance must be at most a tenth of the workspace's narrowest axis, "
                f"{largest:g}, got {self.tolerance:g}"
            )
        if self.driver == "xarm":
            yield from self._xarm_problems()

    def _xarm_problems(self) -> Iterator[str]:
        if self.axes != ("x", "y", "z"):
            yield f"an xArm's workspace has x, y and z, got {', '.join(self.axes)}"
        if not self.speed <= FASTEST_MM_S:
            yield f"speed must be at most {FASTEST_MM_S:g} mm/s, got {self.speed:g}"
        if not self.acceleration <= FASTEST_MM_S2:
            most = f"{FASTEST_MM_S2:g} mm/s²"
            yield f"acceleration must be at most {most}, got {self.acceleration:g}"
        if not all(abs(end) <= FARTHEST_MM for ends in self.workspace.values() for end in ends):
            yield (
                f"the workspace reaches more than {FARTHEST_MM:g} mm from the base, "
                "farther than any xArm; expected mm of its base frame"
            )
        if not 1 <= self.collision_sensitivity <= 5:
            yield f"collision_sensitivity must be 1 to 5, got {self.collision_sensitivity}"
