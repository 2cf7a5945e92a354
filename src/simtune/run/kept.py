"""What a run's folder keeps, read without opening it; nothing is written."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.run import checkpoint
from simtune.run.config import check_same, stored_config
from simtune.run.files import plain

CHECKPOINTS = "checkpoints"


def stored_state(path: Path, config: Mapping[str, Any]) -> dict[str, Any] | None:
    """The state from which `RunFolder.create` would resume; None: a new run. Writes nothing.

    Raises InputError like `create`.
    """
    try:
        if stored_run(path, config) is None:
            return None
        return kept_state(path)  # `create` warns of damaged checkpoints
    except OSError as error:
        raise InputError(f"cannot read the run folder {path}: {error.strerror}") from error


def kept_state(path: Path) -> dict[str, Any] | None:
    """The state of a run's newest sound checkpoint; None if there is none."""
    newest = checkpoint.newest(path / CHECKPOINTS, warn=False)
    return checkpoint.load_state(newest) if newest else None


def kept_since(path: Path) -> float | None:
    """Time of the newest sound checkpoint, in seconds since 1970; None if there is none."""
    newest = checkpoint.newest(path / CHECKPOINTS, warn=False)
    return newest.stat().st_mtime if newest else None


def stored_run(path: Path, config: Mapping[str, Any]) -> dict[str, Any] | None:
    """config.json of the run at `path`; None: a new run. Raises InputError if `config` differs."""
    stored = stored_config(path)
    if stored is not None:
        check_same(path, stored, plain(config))
    return stored
