"""What `simtune check` carries out: its checks, or the search for a camera's pose."""

from typing import Any

from simtune.checking.check import check
from simtune.checking.table import table
from simtune.config import CheckConfig
from simtune.progress import ReportProgress


def carry_out(config: CheckConfig, report: ReportProgress) -> tuple[dict[str, Any], list[str]]:
    """The result as JSON, and the lines that show it. Raises InputError for invalid input."""
    if config.camera_pose:
        from simtune.camera_pose import find_camera_pose, lines  # and Warp, which takes seconds

        camera = find_camera_pose(config, report)
        return camera, lines(camera, config.camera_pose)
    found = check(config, report)
    return found, table(found)
