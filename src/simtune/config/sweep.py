"""The options of `simtune sweep` and `simtune figures`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.checks import at_least
from simtune.config.prints import Prints
from simtune.errors import InputError


@dataclass(frozen=True, kw_only=True)
class SweepConfig(Prints):
    """Carry out a grid of runs of `tune` and `train` (docs/sweeps.md).

    Each run is the ordinary command in a folder of its own, OUT/runs/NAME; OUT/sweep.json says how
    all of them stand. The same command goes on with whatever was stopped or killed.
    """

    grid: Annotated[Positional[Path], arg(metavar="GRID")]
    """A TOML file of what to run."""
    out: Path
    """The sweep's folder."""
    workers: int | None = None
    """Runs at a time on this machine; by default as many as its cores suffice for."""
    cores_per_run: int = 1
    """Cores that each run is bound to, which it shares with no other run of any sweep."""
    retries: int = 2
    """How often a run that failed is tried again, before it is listed as failed."""
    ray: str | None = None
    """The address of a Ray cluster to carry the runs out, such as `auto`, in place of workers on
    this machine; OUT must be a folder that all of its machines share. Needs simtune[ray]."""
    dry_run: bool = False
    """Carry out nothing but a short pilot of each kind of run, and say how long all will take."""
    pilot_minutes: float = 2.0
    """With --dry-run: how long each pilot takes at most."""

    def check(self) -> None:
        """Raises InputError for numbers that make no sense."""
        at_least(self, 1, "workers", "cores_per_run")
        at_least(self, 0, "retries")
        if not self.pilot_minutes > 0:
            raise InputError(f"--pilot-minutes must be above 0, got {self.pilot_minutes:g}")
        if self.ray is not None and self.workers is not None:
            raise InputError("--workers are of this machine: Ray decides how many runs go at once")


@dataclass(frozen=True, kw_only=True)
class FiguresConfig(Prints):
    """Draw what the runs in a folder say together: curves, ablations, tables.

    Reads run folders alone, however they came about, and writes DIR/figures.html, and each figure
    as SVG, PNG and CSV into DIR/figures.
    """

    folder: Annotated[Positional[Path], arg(metavar="DIR")]
    """A folder with run folders in it, such as that of a sweep."""
