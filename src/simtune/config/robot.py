"""What a robot's file says, to go with `--real xarm` and `--real lerobot`."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from simtune.errors import InputError, UnknownName

Driver = Literal["xarm", "lerobot"]

FASTEST_MM_S = 250.0  # what ISO 10218-1 calls reduced speed
FASTEST_MM_S2 = 2000.0  # which reaches that within 16 mm
FARTHEST_MM = 1000.0  # no xArm reaches as far from its base
_MOST_TOLERANCE = 0.1  # of the narrowest axis: with more, the workspace would be none


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """Of an xArm, a RealSense; of a robot with LeRobot's interface, one of its own cameras."""

    name: str | None  # a RealSense's serial number, a robot's camera; None: the only one
    playback: Path | None  # what a RealSense recorded, in its place
    recorded_px: int  # side of the pictures that are kept


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """A robot, in its own coordinates: mm of an xArm's base frame, or what LeRobot's takes."""

    file: Path
    driver: Driver
    address: str  # xArm: its controller's IP address; lerobot: MODULE:FUNCTION that makes it
    moved: tuple[str, ...]  # (A,) what each of the task's actions moves, such as "-y"
    step: float  # by how much an action of 1 does, units
    workspace: dict[str, tuple[float, float]]  # lowest and highest place on each of the D axes
    start: tuple[float, ...]  # (D,) where episodes begin
    speed: float  # units/s, at most
    tolerance: float  # how far outside of the workspace it may be measured, units
    acceleration: float  # units/s²
    collision_sensitivity: int  # xArm's, from 1 to 5, which stops at the slightest touch
    ask: bool  # whether each episode waits for a person's word
    camera: CameraConfig

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.workspace)

    @property
    def latch(self) -> Path:
        """Where it is noted down that the robot was stopped."""
        return self.file.with_name(f"{self.file.name}.stopped")

    def check(self) -> None:
        """Raises InputError for what makes no sense."""
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
