"""A folder of NumPy's NAME.npz, one per episode, e.g. of arrays in Python (docs/recordings.md)."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings.choosing import choose_camera, kept_episodes
from simtune.recordings.episode_arrays import EpisodeArrays, is_camera
from simtune.recordings.npz import UNREADABLE
from simtune.recordings.readings import gather, readings_of
from simtune.recordings.source import Reading, Rows, natural, nearest_rows, short

ENDING = ".npz"  # case-insensitive
_ACTION_KEYS = ("actions", "action_names", "hz")


class ArraysSource:
    """Episodes with `hz`, `actions` (T, A) and optionally `action_names` (A,).

    `frames` (T + 1, H, W, 3) uint8, or `frames.NAME` for each camera, are taken before each action
    and after the last; the last frame may be missing. Other arrays are readings, one row per frame.
    Raises InputError if a file differs from this.
    """

    kind = "folder of arrays"

    def __init__(
        self,
        folder: Path,
        camera: str | None = None,
        *,
        pictures: bool = True,
        leave_out: Sequence[str] = (),
    ):
        self.path = folder
        self.files: Sequence[Path] = sorted(_found(folder), key=lambda path: natural(path.stem))
        self.episodes: Sequence[str] = [path.stem for path in self.files]
        self.robot_type: str | None = None
        self.kept = kept_episodes(folder, self.episodes, leave_out)
        first = EpisodeArrays.load(self._first)
        self.camera = _choose_camera(folder, first, camera) if pictures else None
        self.fps, self.action_names = first.hz(), first.action_names()
        self.readings: Sequence[Reading] = [
            reading
            for key in sorted(first.arrays)
            if key not in _ACTION_KEYS and not is_camera(key)
            for reading in readings_of(key, (), first.width(key))
        ]

    @property
    def _first(self) -> Path:
        return self.files[self.kept[0]]

    def codec(self, episode: int) -> str:
        return "raw"

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        stored = EpisodeArrays.load(self.files[episode])
        actions, names = stored.table("actions"), stored.action_names()
        if names != self.action_names:
            raise InputError(
                f"{stored.path}: expected the actions of {self._first.name} "
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
        stored = EpisodeArrays.load(self.files[episode])
        frames, hz = stored.pictures(self.camera), stored.hz()
        for row in nearest_rows(stored.path, times_s, hz, len(frames)):
            yield row / hz, frames[row]

    def _read(self, stored: EpisodeArrays, key: str) -> np.ndarray:
        """(T, D) readings, as many as in the first used file."""
        table, num = stored.table(key), sum(reading.key == key for reading in self.readings)
        if table.shape[1] != num:
            raise InputError(
                f"{stored.path}: expected {num} numbers of {key} in a row, as in "
                f"{self._first.name}, got {table.shape[1]}"
            )
        return table


def _found(folder: Path) -> list[Path]:
    """The files of arrays in a folder, of which some may be no episodes."""
    return [path for path in folder.glob("[!.]*") if path.suffix.lower() == ENDING]


def holds_episodes(folder: Path) -> bool:
    """Whether a folder has files of episodes; a camera's calibration has no `hz`."""
    for path in _found(folder):
        try:
            with np.load(path, allow_pickle=False) as file:
                if "hz" in file.files:
                    return True
        except UNREADABLE:
            continue
    return False


def _choose_camera(folder: Path, episode: EpisodeArrays, asked: str | None) -> str:
    cameras = [key for key in sorted(episode.arrays) if is_camera(key)]
    if not cameras:
        raise InputError(
            f"{episode.path}: has no pictures; expected frames (T + 1, H, W, 3) uint8, there are: "
            f"{short(sorted(episode.arrays))}"
        )
    return choose_camera(folder, cameras, asked, "frames.{}")
