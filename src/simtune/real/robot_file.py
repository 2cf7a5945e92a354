"""Reads a robot's file, which docs/robot.md describes."""

import contextlib
import ipaddress
from pathlib import Path

from simtune.config.robot import CameraConfig, Driver, RobotConfig
from simtune.tasks.tuning_file.toml_table import TomlTable, read_toml

_KEYS = ("address", "speed", "tolerance", "acceleration", "collision_sensitivity", "ask")
_KEYS += ("actions", "workspace", "start", "camera")
_XARM_SPEED_MM_S, _XARM_TOLERANCE_MM = 100.0, 5.0


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
