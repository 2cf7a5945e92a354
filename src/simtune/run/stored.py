"""Reads the JSON files of a run's folder."""

from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.run.files import read_json


def read_object(path: Path) -> dict[str, Any]:
    """A JSON file's object; empty if there is no file. Raises InputError."""
    if not path.exists():
        return {}
    try:
        value = read_json(path)
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} is damaged: it holds no object")
    return value


def read_result(run: Path) -> dict[str, Any] | None:
    """result.json of a run's folder; None if it is missing or damaged."""
    try:
        return read_object(run / "result.json") or None
    except (OSError, InputError):
        return None
