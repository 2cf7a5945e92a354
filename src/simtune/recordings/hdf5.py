"""Reads HDF5 files from untrusted sources: no links to other files, no huge chunks."""

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.recordings.source import short

_MOST_CHUNK_BYTES = 1 << 28  # a chunk is unpacked as a whole


def open_file(path: Path) -> Any:
    """Open a file. Raises InputError if it is not HDF5, or h5py is not installed."""
    try:
        import h5py
    except ImportError:
        raise InputError(f"{path}: reading HDF5 needs h5py: pip install h5py") from None
    with sound(path):
        return h5py.File(path, "r")


def keys(group: Any) -> list[str]:
    """Keys of a group; an empty list if it is not a group."""
    return list(group) if hasattr(group, "keys") else []


def stored(where: str, file: Any, group: str, key: str) -> Any:
    """The dataset `key` of a file's group; messages call the group `where`.

    Raises InputError if there is none, or it lies in another file, or its chunks are too large.
    """
    with sound(where):
        found: Any = file[group].get(key) if keys(file[group]) else None
        if not hasattr(found, "shape"):
            raise InputError(f"{where} has no {key}; there are: {short(_beside(file[group], key))}")
        # An HDF5 file can refer to data in any other file that its reader may read.
        if found.file.filename != file.filename or found.external or found.is_virtual:
            raise InputError(f"{where}: {key} leads out of the file")
        chunk_bytes = math.prod(found.chunks or ()) * found.dtype.itemsize
        if chunk_bytes > _MOST_CHUNK_BYTES:
            raise InputError(
                f"{where}: {key} is stored in chunks of {chunk_bytes / 1e6:.0f} MB; "
                "expected some pictures each, write the file anew"
            )
        return found


def _beside(group: Any, key: str) -> list[str]:
    """Keys of a group that lie where `key` would; all of the group's if there is no such place."""
    parent = key.rpartition("/")[0]
    its = keys(group.get(parent)) if parent and keys(group) else []
    return [f"{parent}/{name}" for name in its] or keys(group)


def read_floats(where: str, found: Any) -> np.ndarray:
    """A whole dataset as float64. Raises InputError if it is damaged, or does not hold numbers."""
    with sound(where):
        return np.asarray(found[()], np.float64)


def is_pictures(found: Any) -> bool:
    """Whether `found` is (T, H, W, 3) uint8."""
    shape = getattr(found, "shape", ())
    return len(shape) == 4 and shape[3] == 3 and found.dtype == np.uint8


@contextlib.contextmanager
def sound(where: object) -> Iterator[None]:
    """Turn exceptions that h5py raises for damaged files into InputErrors."""
    try:
        yield
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else "damaged"
        raise InputError(f"{where}: not readable as HDF5 ({reason}); copy the file again") from None
