"""The options of `simtune export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from simtune.config.option_checks import at_least
from simtune.config.prints import Prints
from simtune.errors import InputError
from simtune.names import ExportFormat


@dataclass(frozen=True, kw_only=True)
class ExportConfig(Prints):
    """Export a run's result: the tuned MJCF, its parameters, and Python code that applies them.

    Writes model.xml with the files it refers to, parameters.json and apply.py into OUT. With
    --samples, also writes draws of the posterior for domain randomisation: samples.csv.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    out: Path
    """The folder to write, which must be new or empty; with --samples it may be a new file
    NAME.csv, NAME.npz or NAME.json, to write only the draws."""
    samples: int | None = None
    """Number of worlds to draw from the joint posterior of all parameters."""
    format: ExportFormat = "samples"
    """A training library for which to write the draws as well, mjlab or MuJoCo Playground: as
    worlds.npz, with a Python module that randomises environments with them."""

    def check(self) -> None:
        """Raises InputError for invalid options."""
        at_least(self, 1, "samples")
        if self.format != "samples" and (self.samples is None or self.is_file):
            raise InputError(f"--format {self.format} needs --samples, and a folder as --out")
        if self.is_file and self.samples is None:
            raise InputError(f"--out {self.out} is for --samples; without them give a folder")
        if self.is_file and self.out.exists():
            raise InputError(f"{self.out} is there already: give --out another name")
        if self.out.is_dir() and any(self.out.iterdir()):
            raise InputError(f"{self.out} is not empty: give --out a new or an empty folder")

    @property
    def is_file(self) -> bool:
        """Whether only the draws are written, to a file."""
        return self.out.suffix in (".csv", ".npz", ".json")
