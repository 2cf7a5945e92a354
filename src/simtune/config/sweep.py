"""The options of `simtune sweep` and `simtune figures`."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.option_checks import at_least, usual_without
from simtune.config.prints import Prints
from simtune.errors import InputError


@dataclass(frozen=True, kw_only=True)
class SweepConfig(Prints):
    """Carry out a grid of runs of `tune` and `train` (docs/sweeps.md).

    Each run is the ordinary command in its own folder, OUT/runs/NAME; OUT/sweep.json has the state
    of all runs. The same command continues a sweep that was stopped or killed.
    """

    grid: Annotated[Positional[Path], arg(metavar="GRID")]
    """A TOML file that lists the runs."""
    out: Path
    """The sweep's folder."""
    workers: int | None = None
    """Number of simultaneous runs on this machine; by default as many as its cores allow."""
    cores_per_run: int = 1
    """Number of cores that each run is bound to; runs of all sweeps use different cores."""
    retries: int = 2
    """How often a failed run is tried again before it is listed as failed."""
    ray: str | None = None
    """The address of a Ray cluster that carries out the runs, such as `auto`, instead of workers on
    this machine; OUT must be a folder that all of its machines share. Needs ray:
    pip install ray."""
    dry_run: bool = False
    """Only run a short pilot of each kind of run, and estimate how long the sweep will take."""
    pilot_minutes: float = 2.0
    """With --dry-run: maximum time of each pilot."""

    def check(self) -> None:
        """Raises InputError for invalid options."""
        at_least(self, 1, "workers", "cores_per_run")
        at_least(self, 0, "retries")
        if not 0 < self.pilot_minutes < math.inf:
            raise InputError(f"--pilot-minutes: a number above 0, got {self.pilot_minutes:g}")
        if not self.dry_run:
            usual_without(self, "--dry-run only", "pilot_minutes")
        if self.ray is not None and self.workers is not None:
            raise InputError("--workers are of this machine: Ray decides how many runs go at once")


@dataclass(frozen=True, kw_only=True)
class FiguresConfig(Prints):
    """Draw figures of all runs in a folder: curves, ablations, tables.

    Reads only run folders, of a sweep or not. Writes DIR/figures.html, and each figure as SVG, PNG
    and CSV into DIR/figures.
    """

    folder: Annotated[Positional[Path], arg(metavar="DIR")]
    """A folder with run folders in it, such as that of a sweep."""
