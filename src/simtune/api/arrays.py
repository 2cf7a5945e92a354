"""Recordings that are in memory, put where a run finds them again when it goes on."""

import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from simtune.errors import InputError

Episode = Mapping[str, ArrayLike]
RealLike = str | PathLike[str] | Sequence[Episode]


def write_arrays(episodes: Sequence[Episode], folder: Path) -> Path:
    """Write FOLDER/HASH/episode_i.npz, by the hash of what they hold, once; returns FOLDER/HASH.

    What must be in an episode: docs/recordings.md, "A folder of arrays". Raises InputError for what
    is no episode.
    """
    arrays = [_arrays(i, episode) for i, episode in enumerate(episodes)]
    if not arrays:
        raise InputError("real holds no episode; expected dicts of arrays, or a path")
    digest = hashlib.sha256()
    for i, episode in enumerate(arrays):
        for key, array in sorted(episode.items()):
            digest.update(f"{i} {key} {array.dtype} {array.shape}\n".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    out = folder / digest.hexdigest()[:16]
    if not out.exists():
        folder.mkdir(parents=True, exist_ok=True)
        unfinished = Path(mkdtemp(dir=folder, prefix=".", suffix=".tmp"))
        for i, episode in enumerate(arrays):
            np.savez(unfinished / f"episode_{i}.npz", **episode)
        unfinished.rename(out)
    return out


def _arrays(i: int, episode: Episode) -> dict[str, Any]:
    if not isinstance(episode, Mapping):
        raise InputError(
            f"real[{i}] is a {type(episode).__name__}; expected a dict of frames, actions and hz, "
            "see docs/recordings.md"
        )
    arrays = {key: np.asarray(value) for key, value in episode.items()}
    if wrong := [key for key, array in arrays.items() if array.dtype.kind not in "fiuU"]:
        raise InputError(f"real[{i}]: expected {wrong[0]} as numbers, got {arrays[wrong[0]].dtype}")
    return arrays
