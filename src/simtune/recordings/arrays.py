"""A folder of NumPy's NAME.npz, one per episode, e.g. of arrays in Python (docs/recordings.md)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings.npz import UNREADABLE, Npz
from simtune.recordings.readings import gather, readings_of
from simtune.recordings.source import (
    MOST_ACTIONS,
    MOST_ROWS,
    Reading,
    Rows,
    choose_camera,
    is_rate,
    natural,
    nearest_rows,
    short,
)
from simtune.recordings.video import MOST_PIXELS

ENDING = ".npz"
_OF_ACTIONS = ("actions", "action_names", "hz")


class ArraysSource:
    """Episodes with `hz`, `actions` (T, A) and optionally `action_names` (A,).

    `frames` (T + 1, H, W, 3) uint8, or `frames.NAME` for each camera, are taken before each action
    and after the last; the last frame may be missing. Other arrays are readings, one row per frame.
    Raises InputError if a file differs from this.
    """

    kind = "folder of arrays"
    codec = "raw"

    def __init__(self, folder: Path, camera: str | None = None, *, pictures: bool = True):
        self.path = folder
        self.files: Sequence[Path] = sorted(
            folder.glob(f"[!.]*{ENDING}"), key=lambda path: natural(path.stem)
        )
        self.episodes: Sequence[str] = [path.stem for path in self.files]
        self.robot_type: str | None = None
        first = _Episode.load(self.files[0])
        self.camera = _choose_camera(folder, first, camera) if pictures else None
        self.fps, self.action_names = first.hz(), first.action_names()
        self.readings: Sequence[Reading] = [
            reading
            for key in sorted(first.arrays)
            if key not in _OF_ACTIONS and not _is_camera(key)
            for reading in readings_of(key, (), first.width(key))
        ]

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        stored = _Episode.load(self.files[episode])
        actions, names = stored.table("actions"), stored.action_names()
        if names != self.action_names:
            raise InputError(
                f"{stored.path}: expected the actions of {self.files[0].name} "
                f"({short(self.action_names)}), got {short(names)}"
            )
        keys = {reading.key for reading in readings} | ({self.camera} if self.camera else set())
        lengths = {key: stored.num_rows(key) for key in sorted(keys)}
        if len(actions) < 2 or set(lengths.values()) - {len(actions), len(actions) + 1}:
            raise InputError(
                f"{stored.path}: expected at least 2 actions, and a row before each, perhaps one "
                f"after the last; got {len(actions)} actions and rows {lengths}"
            )
        num = min(lengths.values(), default=len(actions))
        # One action per picture; the action after the last picture is not used.
        actions = np.concatenate([actions, actions[-1:]])[:num]
        times_s = np.arange(num) / stored.hz()
        found = gather(readings, num, lambda key: self._read(stored, key)[:num])
        return Rows(actions, times_s, float(times_s[-1]), found)

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        assert self.camera is not None, "opened with pictures"
        stored = _Episode.load(self.files[episode])
        frames, hz = stored.pictures(self.camera), stored.hz()
        for row in nearest_rows(stored.path, times_s, hz, len(frames)):
            yield row / hz, frames[row]

    def _read(self, stored: "_Episode", key: str) -> np.ndarray:
        """(T, D) readings, as many as in the first file."""
        table, num = stored.table(key), sum(reading.key == key for reading in self.readings)
        if table.shape[1] != num:
            raise InputError(
                f"{stored.path}: expected {num} numbers of {key} in a row, as in "
                f"{self.files[0].name}, got {table.shape[1]}"
            )
        return table


@dataclass(frozen=True)
class _Episode:
    path: Path
    arrays: Mapping[str, np.ndarray]

    @classmethod
    def load(cls, path: Path) -> "_Episode":
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
            raise InputError(
                f"{self.path}: expected {key} as {wanted}, got {found.shape} {found.dtype}"
            )
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

        1 if it is beyond the limits of a table: only reading it raises the error.
        """
        array = self._seen(key)
        if array.dtype.kind not in "fiu" or array.ndim not in (1, 2):
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


def _is_table(array: np.ndarray) -> bool:
    """Whether it has rows of numbers, no more than an episode may have."""
    if array.ndim not in (1, 2):
        return False
    return len(array) <= MOST_ROWS and math.prod(array.shape[1:]) <= MOST_ACTIONS


def check_episode(name: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Raises InputError, which begins with `name`, if arrays cannot be those of an episode."""
    episode = _Episode(Path(name), arrays)
    episode.hz()
    episode.action_names()
    if not np.isfinite(episode.table("actions")).all():
        raise InputError(f"{name}: expected finite actions, got NaN or infinity")
    for key in filter(_is_camera, arrays):
        episode.pictures(key)


def holds_episodes(folder: Path) -> bool:
    """Whether a folder has files of episodes; a camera's calibration has no `hz`."""
    for path in folder.glob(f"[!.]*{ENDING}"):
        try:
            with np.load(path, allow_pickle=False) as file:
                if "hz" in file.files:
                    return True
        except UNREADABLE:
            continue
    return False


def _is_camera(key: str) -> bool:
    return key == "frames" or key.startswith("frames.")


def _choose_camera(folder: Path, episode: _Episode, asked: str | None) -> str:
    cameras = [key for key in sorted(episode.arrays) if _is_camera(key)]
    if not cameras:
        raise InputError(
            f"{episode.path}: has no pictures; expected frames (T + 1, H, W, 3) uint8, there are: "
            f"{short(sorted(episode.arrays))}"
        )
    return choose_camera(folder, cameras, asked, "frames.{}")
