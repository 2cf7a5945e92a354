"""The options of `simtune export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """Take what a run found along: the tuned MJCF, its numbers, and Python that applies them.

    Writes model.xml, with the files that it refers to, parameters.json and apply.py into OUT.
    """

    run_folder: Annotated[Positional[Path], arg(metavar="RUN")]
    """A folder that `simtune tune` or `simtune train` wrote."""
    out: Path
    """The folder to write, which must not be there yet, or be empty."""
