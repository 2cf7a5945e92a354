"""Reads JSON files from untrusted sources: with one object, or with one object per line."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from simtune.errors import InputError

_MOST_BYTES = 100_000_000  # of a file, since even a single line is read as a whole


def read_object(path: Path) -> dict[str, Any]:
    """The object in a file. Raises InputError if the file does not hold one."""
    with _readable(path):
        text = path.read_text(encoding="utf-8")
    return _object(text, str(path))


def read_objects(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each non-empty line's name in messages, and its object. Raises InputError."""
    with _readable(path), path.open(encoding="utf-8") as file:
        for number, line in enumerate(file, start=1):
            if line.strip():
                where = f"{path}: line {number}"
                yield where, _object(line, where)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise InputError(f"{path}: expected a few kB, got {size / 1e6:.0f} MB")
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: missing; copy the dataset again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from None


def _object(text: str, where: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not readable as JSON ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{where}: expected a JSON object, got {type(content).__name__}")
    return content
