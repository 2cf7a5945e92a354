"""The options of `simtune tune` and `simtune check`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.camera_pose import CameraPoseOptions
from simtune.config.checks import at_least, check_seed
from simtune.config.prints import Prints
from simtune.config.real import ObservesSized, RealConfig, RecordingsConfig
from simtune.errors import InputError
from simtune.names import SearchName


@dataclass(frozen=True, kw_only=True)
class TuneConfig(Prints, ObservesSized, RealConfig):
    """Find a simulator's parameters from video and actions of the real world.

    Writes result.json, report.html, metrics and videos into OUT. The same command goes on with
    a run that was interrupted.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    out: Path
    """The run's folder."""
    real_episodes: int | None = None
    """How many real episodes to film (by default 5), or to take from the recordings (by default
    all, at most 10)."""
    search: SearchName = "posterior"
    """posterior: read survival curves; paper: small steps up or down; regression: its baseline."""
    budget_minutes: float = 8.0
    """Wall time at most, but for some seconds; less where the precision is reached before."""
    precision: str = "1%"
    """A percentage: stop once half of every 90 % interval is at most so much of the estimate. 0%
    goes on until the time is over."""

    @property
    def relative_precision(self) -> float:
        """As a share of the estimate; NaN for what is no percentage."""
        try:
            return float(self.precision.removesuffix("%")) / 100
        except ValueError:
            return float("nan")

    def check(self) -> None:
        """Raises InputError for numbers that make no sense."""
        self.check_real()
        self.check_image_size()
        at_least(self, 1, "real_episodes")
        if not self.budget_minutes > 0:
            raise InputError(f"--budget-minutes must be above 0, got {self.budget_minutes:g}")
        if self.known_colour is not None and self.search != "posterior":
            raise InputError(f"--known-colour goes with --search posterior, got {self.search}")
        if not 0 <= self.relative_precision < 1:
            raise InputError(f"--precision must be a percentage such as 1%, got {self.precision}")


@dataclass(frozen=True, kw_only=True)
class CheckConfig(Prints, ObservesSized, CameraPoseOptions, RecordingsConfig):
    """Say, before any training, what each parameter changes and what recordings can tell of it.

    Takes seconds, beside reading recordings. What a parameter "shows" is the best that can be
    hoped for. Of recordings it writes one file: pictures of them beside the simulator's.
    """

    task: Annotated[Positional[str], arg(metavar="TASK")]
    """A built-in task (see `simtune tasks`), or a tuning file (docs/tuning-file.md)."""
    real: Path | None = None
    """Recordings (docs/recordings.md), whose actions are replayed; by default they are random, or
    the task's script with noise. All episodes are looked through."""
    episodes: int | None = None
    """How many episodes to simulate (by default 5), or to replay of the recordings (by default
    all, at most 10)."""
    seed: int = 0
    """Of the actions and of where simulated episodes start."""
    pictures: Path | None = None
    """With recordings: where to save their first frames beside the simulator's, as FILE.png; by
    default a new file in the system's folder for temporary ones, whose name is printed."""

    def check(self) -> None:
        """Raises InputError for what makes no sense."""
        if self.real is not None and str(self.real) == "pseudo" and not self.real.exists():
            raise InputError("check simulates by itself what it needs: leave out --real pseudo")
        self.check_recordings(self.real is not None)
        self.check_image_size()
        self.check_camera_pose(self.real)
        at_least(self, 1, "episodes")
        check_seed(self.seed)
        if self.pictures is not None:
            self._check_pictures(self.pictures)

    def _check_pictures(self, path: Path) -> None:
        if self.real is None:
            raise InputError("--pictures goes with recordings only")
        if path.suffix.lower() != ".png":
            raise InputError(f"--pictures must be a file that ends in .png, got {path}")
        if not path.parent.is_dir():
            raise InputError(f"--pictures {path}: there is no folder {path.parent}; make it first")
        if path.is_dir():
            raise InputError(f"--pictures {path}: is a folder; name a file")
