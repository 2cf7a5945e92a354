"""The options of `simtune check`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.camera_pose import CameraPoseOptions
from simtune.config.option_checks import at_least, check_seed
from simtune.config.picture_files import check_replaceable
from simtune.config.prints import Prints
from simtune.config.real import NO_RECORDINGS, PictureOptions, RecordingsConfig
from simtune.errors import InputError


@dataclass(frozen=True, kw_only=True)
class CheckConfig(Prints, PictureOptions, CameraPoseOptions, RecordingsConfig):
    """Show, before tuning, what each parameter changes and how well recordings can determine it.

    Takes seconds, plus the time to read recordings. What a parameter "shows" is the best precision
    to hope for; of recorded readings also what to expect if the model leaves as much of them as a
    simple lag does. With recordings, writes a picture for each camera, their first frames beside
    the simulator's, and one of how joints follow their commands.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    real: Path | None = None
    """Recordings (docs/recordings.md), whose actions are replayed; by default actions are random,
    or of the task's script with noise. All episodes are read."""
    episodes: int | None = None
    """Number of episodes to simulate (by default 5), or to replay from the recordings (by default
    all, at most 10)."""
    image_size: int | None = None
    """Height of pictures in pixels; by default 64, or up to 128 if what moves is small, and 240
    with --camera-pose."""
    seed: int = 0
    """Random seed of the actions and of the initial states of simulated episodes."""
    pictures: Path | None = None
    """With recordings: FILE.png for their first frames beside the simulator's, and for how joints
    follow their commands. PNG files of these names are replaced, others are not. By default new
    files in the system's temporary folder, whose names are printed."""

    def check(self) -> None:
        """Raises InputError for invalid options."""
        self._check_real()
        self.check_recordings(self.real is not None)
        self.check_image_size()
        self.check_camera_pose(self.real)
        at_least(self, 1, "episodes")
        check_seed(self.seed)
        if self.pictures is not None:
            self._check_pictures(self.pictures)

    def _check_real(self) -> None:
        if self.real is None or str(self.real) not in NO_RECORDINGS or self.real.exists():
            return
        if str(self.real) == "pseudo":
            raise InputError("check simulates by itself what it needs: leave out --real pseudo")
        raise InputError(
            f"--real {self.real} is a robot, and check moves none: give recordings, or leave "
            "--real out"
        )

    def _check_pictures(self, path: Path) -> None:
        if self.real is None:
            raise InputError("--pictures goes with recordings only")
        if self.camera_pose is not None:
            raise InputError("--pictures goes with a check without --camera-pose only")
        if path.suffix.lower() != ".png":
            raise InputError(f"--pictures must be a file that ends in .png, got {path}")
        if not path.parent.is_dir():
            raise InputError(f"--pictures {path}: there is no folder {path.parent}; make it first")
        if path.is_dir():
            raise InputError(f"--pictures {path}: is a folder; name a file")
        for file in (path, path.with_stem(f"{path.stem}-servos")):
            check_replaceable(file, path)
