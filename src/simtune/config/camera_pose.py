"""The options of `simtune check --camera-pose`."""

import os
from dataclasses import dataclass
from pathlib import Path

from simtune.config.option_checks import flag, usual_without
from simtune.errors import InputError


@dataclass(frozen=True, kw_only=True)
class CameraPoseOptions:
    """Options for finding a camera's pose from joint readings."""

    camera_pose: Path | None = None
    """Only find the pose of the recordings' camera, from [[sensors]] of the robot's joints, and
    write it as FILE.toml. The tuning file's pose is the first guess."""
    within_m: float = 0.3
    """With --camera-pose: how far the camera may be from the first guess, along each axis."""
    within_deg: float = 25.0
    """With --camera-pose: how far it may be rotated from the first guess, about each axis."""
    within_fov_deg: float = 0.0
    """With --camera-pose: how far its field of view may differ. By default it is taken as known,
    since a nearer camera with a wider view sees nearly the same."""
    budget_minutes: float = 2.0
    """With --camera-pose: maximum time. With more time, more pictures are compared."""

    def check_camera_pose(self, real: Path | None) -> None:
        """Raises InputError for invalid options."""
        if self.camera_pose is None:
            own = ("within_m", "within_deg", "within_fov_deg", "budget_minutes")
            usual_without(self, "--camera-pose only", *own)
            return
        if real is None:
            raise InputError("--camera-pose goes with recordings only: give --real DIR")
        if self.camera_pose.suffix != ".toml" or not self.camera_pose.parent.is_dir():
            raise InputError(
                f"--camera-pose {self.camera_pose}: expected a new file NAME.toml in a folder that "
                "is there"
            )
        if not os.access(self.camera_pose.parent, os.W_OK):
            raise InputError(f"--camera-pose {self.camera_pose}: its folder cannot be written into")
        if self.camera_pose.exists():
            raise InputError(f"--camera-pose {self.camera_pose}: exists already; name a new file")
        limits = {"within_m": 10.0, "within_deg": 60.0, "within_fov_deg": 60.0}
        for name, most in {**limits, "budget_minutes": 1e4}.items():
            got, may_be_0 = getattr(self, name), name == "within_fov_deg"
            if not 0 <= got <= most or (got == 0 and not may_be_0):
                least = "at least 0" if may_be_0 else "above 0"
                raise InputError(f"{flag(name)} must be {least} and at most {most:g}, got {got:g}")
