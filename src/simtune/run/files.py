"""Files that are never half-written: replaced as a whole, or appended to line by line."""

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace a file: readers, also after a crash, see either the old content or the new."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")  # others may write the same file
    try:
        with temporary.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:  # the error of a full disk does not name the file
        temporary.unlink(missing_ok=True)  # it would take the room that is waited for
        raise type(error)(error.errno, error.strerror, str(path)) from None
    os.replace(temporary, path)
    sync_folder(path.parent)


def write_json(path: Path, value: Any) -> None:
    """Replace a JSON file, atomically."""
    write_atomically(path, json.dumps(plain(value), indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """The content of a JSON file. Raises OSError, and ValueError if it is not JSON."""
    return json.loads(path.read_text(encoding="utf-8"))


def append_jsonl(path: Path, value: Mapping[str, Any]) -> None:
    """Append one object as a line; it is passed to the operating system before this returns."""
    line = json.dumps(plain(value), allow_nan=False) + "\n"
    with path.open("a", encoding="utf-8") as file:
        file.write(line)


def read_jsonl(path: Path) -> list[dict[str, Any]]:
    """The objects of a JSON-lines file, in order; empty if the file is missing.

    A line that a crash left half-written is skipped.
    """
    if not path.exists():
        return []
    objects = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            value = json.loads(line)
        except ValueError:
            continue
        if isinstance(value, dict):
            objects.append(value)
    return objects


def keep_lines(path: Path, count: int) -> None:
    """Truncate a JSON-lines file to its first `count` valid lines."""
    if path.exists():
        kept = [json.dumps(value) + "\n" for value in read_jsonl(path)[:count]]
        write_atomically(path, "".join(kept))


def sync(path: Path) -> None:
    """Force a file onto the disk, if it exists."""
    if path.exists():
        with path.open("rb") as file:
            os.fsync(file.fileno())


def sync_folder(path: Path) -> None:
    """Force a folder's entries onto the disk, so that a rename survives a power cut."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def plain(value: Any) -> Any:
    """Convert `value` to JSON types: arrays to lists, paths to text, NaN and infinity to null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value))
    to_list = getattr(value, "tolist", None)  # numpy's and torch's arrays and scalars
    return value if to_list is None else plain(to_list())
