"""A robot's file, for `--real xarm` and `--real lerobot`; docs/robot.md describes it."""

import contextlib
import ipaddress
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from simtune.errors import InputError, UnknownName
from simtune.toml_reading import TomlTable, read_toml

Driver = Literal["xarm", "lerobot"]

_FASTEST_MM_S = 250.0  # reduced speed by ISO 10218-1
_FASTEST_MM_S2 = 2000.0  # reaches that speed within 16 mm
_FARTHEST_MM = 1000.0  # beyond the reach of any xArm from its base
_MOST_TOLERANCE = 0.1  # share of the narrowest axis: a larger one would defeat the workspace
_KEYS = ("address", "speed", "tolerance", "acceleration", "collision_sensitivity", "ask")
_KEYS += ("actions", "workspace", "start", "camera")
_XARM_SPEED_MM_S, _XARM_TOLERANCE_MM = 100.0, 5.0


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
        if not self.speed <= _FASTEST_MM_S:
            yield f"speed must be at most {_FASTEST_MM_S:g} mm/s, got {self.speed:g}"
        if not self.acceleration <= _FASTEST_MM_S2:
            most = f"{_FASTEST_MM_S2:g} mm/s²"
            yield f"acceleration must be at most {most}, got {self.acceleration:g}"
        if not all(abs(end) <= _FARTHEST_MM for ends in self.workspace.values() for end in ends):
            yield (
                f"the workspace reaches more than {_FARTHEST_MM:g} mm from the base, "
                "farther than any xArm; expected mm of its base frame"
            )
        if not 1 <= self.collision_sensitivity <= 5:
            yield f"collision_sensitivity must be 1 to 5, got {self.collision_sensitivity}"


def read_robot(file: Path, driver: Driver) -> RobotConfig:
    """Read a robot's TOML file. Raises InputError "FILE:LINE: ..." """
    table = read_toml(file)
    table.allow(*_KEYS)
    actions, start, camera = (table.table(key) for key in ("actions", "start", "camera"))
    actions.allow("moved", "step")
    workspace, is_xarm = _workspace(table), driver == "xarm"
    start.allow(*workspace)
    if is_xarm:  # its axes have an order, which the table need not follow
        workspace = dict(sorted(workspace.items()))
        _check_ip(table)
    config = RobotConfig(
        file=file,
        driver=driver,
        address=table.text("address"),
        moved=actions.names("moved"),
        step=actions.number("step", above=0),
        workspace=workspace,
        start=tuple(start.number(axis) for axis in workspace),
        # Without defaults for other robots: their units are unknown.
        speed=table.number("speed", *[_XARM_SPEED_MM_S] * is_xarm, above=0),
        tolerance=table.number("tolerance", *[_XARM_TOLERANCE_MM] * is_xarm, above=0),
        acceleration=table.number("acceleration", 1000.0, above=0),
        collision_sensitivity=table.whole("collision_sensitivity", 3),
        ask=table.flag("ask", True),
        camera=_camera(camera),
    )
    config.check()
    return config


def _check_ip(table: TomlTable) -> None:
    """Raise InputError unless it is an IP address: else the SDK would take it for a serial port."""
    address = table.text("address")
    with contextlib.suppress(ValueError):
        ipaddress.IPv4Address(address)
        return
    if address != "localhost":
        raise table.error(
            f"address must be the controller's IP address, such as 192.168.1.203, got {address}",
            "address",
        )


def _workspace(table: TomlTable) -> dict[str, tuple[float, float]]:
    workspace = table.table("workspace")
    if not list(workspace):
        raise table.error("expected a table [workspace] of axes, each with lowest and highest")
    for axis in workspace:
        low, high = workspace.pair(axis)
        if low == high:
            raise workspace.error(f"{axis} leaves no room: {low:g} to {high:g}", axis)
    return {axis: workspace.pair(axis) for axis in workspace}


def _camera(table: TomlTable) -> CameraConfig:
    table.allow("name", "playback", "recorded_px")
    playback = table.text("playback", None)
    recorded_px = table.whole("recorded_px", 256, least=16)
    if recorded_px % 2:
        raise table.error(f"recorded_px must be even, for the video, got {recorded_px}")
    return CameraConfig(
        name=table.text("name", None),
        playback=playback and table.file.parent / playback,
        recorded_px=recorded_px,
    )
