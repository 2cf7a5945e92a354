"""Writes recordings from memory to files, where a resumed run finds them."""

import hashlib
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from io import BytesIO
from os import PathLike
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from simtune.errors import InputError, blame
from simtune.recordings import check_episode, in_words
from simtune.run.files import sync_folder, write_atomically

log = logging.getLogger(__name__)
Episode = Mapping[str, ArrayLike]
FilmEpisode = Callable[[int], Episode]  # films an episode, counted from 0
EPISODES = "episodes"  # name of the folder that filmed ones are in
RealLike = str | PathLike[str] | Sequence[Episode] | FilmEpisode


def write_arrays(episodes: Sequence[Episode], folder: Path) -> Path:
    """Write FOLDER/HASH/episode_i.npz unless they exist; returns FOLDER/HASH.

    HASH depends on the content. The format of an episode: docs/recordings.md, "A folder of arrays".
    Raises InputError for anything else.
    """
    if isinstance(episodes, Mapping) or not isinstance(episodes, Iterable):
        raise InputError(
            f"real is a {type(episodes).__name__}; expected a path, a list of dicts of arrays (one "
            "for each episode), or a function that films one"
        )
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
            _write(unfinished / f"episode_{i}.npz", episode)
        unfinished.rename(out)
        sync_folder(folder)
    return out


def film_once(record: FilmEpisode, num: int, folder: Path) -> Path:
    """Film `num` episodes, e.g. of a robot, into FOLDER/episodes; returns that path.

    Each is written before the next one is filmed. If all are there, nothing is filmed, and what was
    interrupted goes on: a resumed run uses its own recordings, and a warning says so, since
    `record` may have been mended meanwhile. Raises InputError like `write_arrays`.
    """
    unfinished, out = folder / ".unfinished", folder / EPISODES
    earlier = [*folder.glob(f"{EPISODES}/*.npz"), *unfinished.glob("*.npz")]
    if earlier:
        log.warning(
            "%s: %d episodes filmed earlier are used, and not filmed again; give another out to "
            "film all anew",
            out,
            len(earlier),
        )
    if out.exists():
        return out
    unfinished.mkdir(parents=True, exist_ok=True)
    for i in range(num):
        path = unfinished / f"episode_{i}.npz"
        if not path.exists():
            _write(path, _arrays(i, record(i)))
    unfinished.rename(out)
    sync_folder(folder)
    return out


def _write(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write an episode that may not be filmed again: whole, and on the disk."""
    content = BytesIO()
    np.savez(content, **arrays)
    write_atomically(path, content.getvalue())


def _arrays(i: int, episode: Episode) -> dict[str, Any]:
    if not isinstance(episode, Mapping):
        raise InputError(
            f"real[{i}] is a {type(episode).__name__}; expected a dict of frames, actions and hz, "
            "see docs/recordings.md"
        )
    arrays = dict[str, Any]()
    for key, value in episode.items():
        wanted = f"real[{i}]: expected {key} as an array"
        with blame(wanted):
            arrays[key] = _texts(value) if key == "action_names" else _array(wanted, value)
    if wrong := [key for key, array in arrays.items() if array.dtype.kind not in "fiuU"]:
        got = in_words(arrays[wrong[0]])
        wanted = "texts" if wrong[0] == "action_names" else "numbers"
        raise InputError(f"real[{i}]: expected {wrong[0]} as {wanted}, got {got}")
    check_episode(f"real[{i}]", arrays)
    _check_rows(i, arrays)
    return arrays


def _array(wanted: str, value: ArrayLike) -> np.ndarray:
    try:
        return np.asarray(value)
    except ValueError as error:
        if "inhomogeneous" in str(error):
            raise InputError(f"{wanted}, its rows of one length: {error}") from error
        raise


def _texts(names: ArrayLike) -> np.ndarray:
    """Names as texts; those of a pandas table's columns, for example, are Python objects."""
    array = np.asarray(names)
    if array.dtype.kind not in "OS":
        return array
    texts = [name.decode() if isinstance(name, bytes) else name for name in array.flat]
    are_texts = all(isinstance(name, str) for name in texts)
    return np.array(texts, str).reshape(array.shape) if are_texts else array


def _check_rows(i: int, arrays: dict[str, Any]) -> None:
    """Check lengths. Raises InputError here, since a later one would name an unknown file."""
    rows = {key: len(array) if array.ndim else 0 for key, array in arrays.items()}
    num = rows.get("actions", 0)
    if num < 2:
        raise InputError(f"real[{i}]: expected at least 2 actions, as actions (T, A), got {num}")
    for key in rows.keys() - {"actions", "action_names", "hz"}:
        if rows[key] not in (num, num + 1):
            raise InputError(
                f"real[{i}]: expected a row of {key} before each of {num} actions, perhaps one "
                f"after the last, got {rows[key]} rows"
            )
