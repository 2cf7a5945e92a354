"""One episode's arrays, of a file or of Python: what each must be."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings.npz import Npz
from simtune.recordings.source import MOST_ACTIONS, MOST_ROWS, is_rate, short
from simtune.recordings.video import MOST_PIXELS

_KINDS = {kind: ("one number", "numbers") for kind in "fiu"} | {
    "U": ("one text", "texts"),
    "S": ("one text as bytes", "texts as bytes"),
    "b": ("one truth value", "truth values"),
    "c": ("one complex number", "complex numbers"),
}


@dataclass(frozen=True)
class EpisodeArrays:
    """An episode's arrays by name, each checked as it is read; `path` begins all errors."""

    path: Path
    arrays: Mapping[str, np.ndarray]

    @classmethod
    def load(cls, path: Path) -> "EpisodeArrays":
        return cls(path, Npz(path))

    def look(self, key: str, ndim: int | None = None) -> np.ndarray:
        """Shape and type of an array of numbers with `ndim` axes, perhaps without the content.

        Raises InputError if there is none.
        """
        if key not in self.arrays:
            raise InputError(f"{self.path}: has no {key}; there are: {short(sorted(self.arrays))}")
        found = self._seen(key)
        if found.dtype.kind not in "fiu" or ndim not in (None, found.ndim):
            wanted = "one number" if ndim == 0 else "numbers"
            wanted += f" of {ndim} axes" * bool(ndim)
            raise InputError(f"{self.path}: expected {key} as {wanted}, got {in_words(found)}")
        return found

    def numbers(self, key: str, ndim: int | None = None) -> np.ndarray:
        """The same with its content."""
        self.look(key, ndim)
        return self.arrays[key]

    def _seen(self, key: str) -> np.ndarray:
        return self.arrays.look(key) if isinstance(self.arrays, Npz) else self.arrays[key]

    def num_rows(self, key: str) -> int:
        return (self.look(key).shape or (1,))[0]

    def hz(self) -> float:
        hz = float(self.numbers("hz", ndim=0))
        if not is_rate(hz):
            raise InputError(f"{self.path}: expected hz as rows a second, got {hz:g}")
        return hz

    def width(self, key: str) -> int:
        """Readings in a row of an array; 0: it cannot hold any.

        1 if it has more axes than a table or is beyond its limits: only reading it raises the
        error.
        """
        array = self._seen(key)
        if array.dtype.kind not in "fiu" or not array.ndim:
            return 0
        return math.prod(array.shape[1:]) if _is_table(array) else 1

    def table(self, key: str) -> np.ndarray:
        """(T, D) float64, from an array (T, D) or (T,). Raises InputError for any other."""
        found = self.look(key)
        width = math.prod(found.shape[1:])
        if not _is_table(found):
            raise InputError(
                f"{self.path}: expected {key} as (T, D) with T up to {MOST_ROWS} and D up to "
                f"{MOST_ACTIONS}, got {found.shape}"
            )
        return self.arrays[key].astype(np.float64).reshape(len(found), width)

    def pictures(self, camera: str) -> np.ndarray:
        """(T + 1, H, W, 3) uint8."""
        frames = self.look(camera, ndim=4)
        height, width, channels = frames.shape[1:]
        if frames.dtype != np.uint8 or channels != 3 or not 0 < height * width <= MOST_PIXELS:
            raise InputError(
                f"{self.path}: expected {camera} as (T + 1, H, W, 3) uint8, got {frames.shape} "
                f"{frames.dtype}"
            )
        return self.arrays[camera]

    def action_names(self) -> tuple[str, ...]:
        num = self.table("actions").shape[1]
        names = self.arrays.get("action_names", np.array([f"action_{i}" for i in range(num)]))
        if names.shape != (num,) or names.dtype.kind not in "U" + "f" * (num == 0):
            raise InputError(f"{self.path}: expected action_names as {num} texts, got {names}")
        return tuple(map(str, names.tolist()))


def in_words(array: np.ndarray) -> str:
    """What an array holds, such as "one text" or "numbers of shape (3, 2)"."""
    one, many = _KINDS.get(array.dtype.kind, ("one Python object", "Python objects"))
    return f"{many} of shape {array.shape}" if array.ndim else one


def _is_table(array: np.ndarray) -> bool:
    """Whether it has rows of numbers, no more than an episode may have."""
    if array.ndim not in (1, 2):
        return False
    return len(array) <= MOST_ROWS and math.prod(array.shape[1:]) <= MOST_ACTIONS


def check_episode(name: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Raises InputError, which begins with `name`, if arrays cannot be those of an episode."""
    episode = EpisodeArrays(Path(name), arrays)
    for key in arrays:
        if not isinstance(key, str) or key == "file":
            raise InputError(
                f"{name}: expected texts as names of arrays, except 'file', which numpy.savez does "
                f"not take; got {key!r:.60}"
            )
    episode.hz()
    episode.action_names()
    if not np.isfinite(episode.table("actions")).all():
        raise InputError(f"{name}: expected finite actions, got NaN or infinity")
    for key in filter(is_camera, arrays):
        episode.pictures(key)


def is_camera(key: str) -> bool:
    return key == "frames" or key.startswith("frames.")
