"""The options of `simtune tune`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.option_checks import at_least, check_known_colour, usual_without
from simtune.config.prints import Prints
from simtune.config.real import PictureOptions, RealConfig
from simtune.errors import InputError
from simtune.names import DEFAULT_SEARCH, SearchName, search_traits, searches_where


@dataclass(frozen=True, kw_only=True)
class TuneConfig(Prints, PictureOptions, RealConfig):
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
    search: SearchName = DEFAULT_SEARCH
    """posterior: by survival curves; paper: by small steps up or down; regression: the paper's
    baseline."""
    budget_minutes: float = 8.0
    """Maximum wall time from start to report, give or take seconds; the run ends earlier if the
    precision is reached. What a robot takes to film is not counted."""
    precision: str = "1%"
    """A percentage: stop once half of every 90 % interval is at most this share of the estimate. 0%
    goes on for all four rounds of a search of videos, as far as the time allows. A search of joint
    readings alone ends once two of its fits agree, whatever this says."""

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
        if not search_traits(self.search).has_intervals:
            usual_without(self, searches_where("has_intervals"), "precision")
        if self.observed == ("joints",):
            usual_without(self, "pictures, and --observe joints looks at none", "image_size")
