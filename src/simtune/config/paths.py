"""Check that the files and folders which a command reads exist, before anything slow happens."""

import difflib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simtune.config.option_checks import flag
from simtune.config.real import NO_RECORDINGS, RealConfig
from simtune.errors import InputError

_RUNS = ("run_folder", "run_folders")
_POSITIONAL = ("task", "folder", "grid")
_OPTIONS = ("real", "parameters", "real_parameters", "robot")


def check_paths(options: Any) -> None:
    """Raises InputError for a missing folder or file that a command's options name.

    The code that reads it would also complain, but only after seconds of loading packages.
    """
    for name in (*_RUNS, *_POSITIONAL, *_OPTIONS):
        value = getattr(options, name, None)
        for path in value if isinstance(value, tuple) else (value,):
            # A text may be too long for a file's name, which Path would not take
            if path is None or path in NO_RECORDINGS or os.path.exists(path):
                continue
            if name == "task" and not path.endswith(".toml"):
                continue
            named = f"{flag(name)} {path}" if name in _OPTIONS else path
            said = f"{named}: no such folder or file"
            if name in _RUNS:
                said = f"{path} is no run: there is no such folder"
            others = NO_RECORDINGS if name == "real" and isinstance(options, RealConfig) else ()
            raise InputError(said + _alike(Path(path), others))


def _alike(path: Path, others: Sequence[str]) -> str:
    """A hint if one of `others`, or a file beside the path, has a similar name, else ""."""
    if close := difflib.get_close_matches(str(path), others, n=1):
        return f"; did you mean {close[0]}?"
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return ""
    close = difflib.get_close_matches(path.name, names, n=1)
    return f"; did you mean {path.parent / close[0]}?" if close else ""
