"""The options of `simtune tune` and `simtune check`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.camera_pose import CameraPoseOptions
from simtune.config.checks import at_least, check_known_colour, check_seed, usual_without
from simtune.config.prints import Prints
from simtune.config.real import NO_RECORDINGS, ObservesSized, RealConfig, RecordingsConfig
from simtune.errors import InputError
from simtune.names import SearchName


@dataclass(frozen=True, kw_only=True)
class TuneConfig(Prints, ObservesSized, RealConfig):
    """Find a simulator's parameters from video and actions of the real world.

    Writes result.json, report.html, metrics and videos into OUT. The same command continues an
    interrupted run.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    out: Path
    """The run's folder."""
    real_episodes: int | None = None
    """Number of real episodes to film (by default 5), or to read from the recordings (by default
    all, at most 10)."""
    search: SearchName = "posterior"
    """posterior: by survival curves; paper: by small steps up or down; regression: the paper's
    baseline."""
    budget_minutes: float = 8.0
    """Maximum wall time, give or take seconds; the run ends earlier if the precision is reached.
    What a robot takes to film is not counted."""
    precision: str = "1%"
    """A percentage: stop once half of every 90 % interval is at most this share of the estimate. 0%
    uses all of the time."""

    @property
    def relative_precision(self) -> float:
        """`precision` as a share of the estimate; NaN if it is not a percentage."""
        try:
            return float(self.precision.removesuffix("%")) / 100
        except ValueError:
            return float("nan")

    def check(self) -> None:
        """Raises InputError for invalid options."""
        self.check_real()
        self.check_image_size()
        at_least(self, 1, "real_episodes")
        if not self.budget_minutes > 0:
            raise InputError(f"--budget-minutes must be above 0, got {self.budget_minutes:g}")
        check_known_colour(self.known_colour, self.search)
        if not 0 <= self.relative_precision < 1:
            raise InputError(f"--precision must be a percentage such as 1%, got {self.precision}")
        if self.search != "posterior":
            usual_without(self, "--search posterior", "precision")
        if self.observed == ("joints",):
            usual_without(self, "pictures, and --observe joints looks at none", "image_size")


@dataclass(frozen=True, kw_only=True)
class CheckConfig(Prints, ObservesSized, CameraPoseOptions, RecordingsConfig):
    """Show, before tuning, what each parameter changes and how well recordings can determine it.

    Takes seconds, plus the time to read recordings. What a parameter "shows" is the best precision
    to hope for. With recordings, writes a picture for each camera, their first frames beside the
    simulator's, and one of how joints follow their commands.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    real: Path | None = None
    """Recordings (docs/recordings.md), whose actions are replayed; by default actions are random,
    or of the task's script with noise. All episodes are read."""
    episodes: int | None = None
    """Number of episodes to simulate (by default 5), or to replay from the recordings (by default
    all, at most 10)."""
    seed: int = 0
    """Random seed of the actions and of the initial states of simulated episodes."""
    pictures: Path | None = None
    """With recordings: FILE.png for their first frames beside the simulator's, and for how joints
    follow their commands; by default new files in the system's temporary folder, whose names are
    printed."""

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
