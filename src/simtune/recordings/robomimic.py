"""robomimic's HDF5: groups /data/demo_i with actions, readings and uncompressed pictures."""

import functools
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.recordings import hdf5
from simtune.recordings.choosing import choose_camera, kept_episodes
from simtune.recordings.readings import gather, readings_of
from simtune.recordings.source import (
    MOST_ACTIONS,
    MOST_ROWS,
    Reading,
    Rows,
    is_rate,
    nearest_rows,
    short,
)
from simtune.recordings.video import MOST_PIXELS

_BLOCK_BYTES = 1 << 24  # size of pictures read at once, since a compressed chunk holds several


class RobomimicSource:
    """A file in robomimic's layout. Row t is a picture and the action applied after it.

    The file is open only while it is read. `fps` is the rate of a file whose env_args do not tell
    it. Raises InputError if the file has another layout, or h5py is not installed.
    """

    kind = "robomimic HDF5"

    def __init__(
        self,
        path: Path,
        camera: str | None = None,
        fps: float | None = None,
        *,
        pictures: bool = True,
        leave_out: Sequence[str] = (),
    ):
        self.path = path
        self.files: Sequence[Path] = [path]
        with hdf5.open_file(path) as file, hdf5.sound(path):
            data = file.get("data", {})
            names = [name for name in hdf5.keys(data) if name.startswith("demo_")]
            if not names:
                act = "observations" in hdf5.keys(file)
                hint = "; ACT's files are converted by lerobot, or saved as arrays" if act else ""
                raise InputError(
                    f"{path}: holds no episode; expected groups /data/demo_0, ...{hint} "
                    "(docs/recordings.md says how others are converted)"
                )
            self.episodes: Sequence[str] = sorted(names, key=lambda name: (len(name), name))
            self.kept = kept_episodes(path, self.episodes, leave_out)
            self.robot_type, own_fps = _environment(data.attrs.get("env_args"))
            observed = self._observed(file)
            self.camera = self._choose_camera(observed, camera) if pictures else None
            self.readings: Sequence[Reading] = [
                reading for key in observed for reading in _readings(key, observed[key])
            ]
            num_actions = self._actions(file, self.kept[0]).shape[1]
        self.action_names = tuple(f"action_{i}" for i in range(num_actions))
        self.fps = own_fps or fps or 0.0
        if not self.fps:
            raise InputError(
                f"{path}: /data says no control_freq in env_args; give the rate as --control-hz"
            )

    def codec(self, episode: int) -> str:
        return "raw"

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        with hdf5.open_file(self.path) as file:
            return self._rows(file, episode, readings)

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        with hdf5.open_file(self.path) as file:
            yield from self._pictures_at(self._pictures(file, episode), episode, times_s)

    def _rows(self, file: Any, episode: int, readings: Sequence[Reading]) -> Rows:
        where, actions = self._where(episode), self._actions(file, episode)
        if actions.shape[1] != (num := len(self.action_names)):
            raise InputError(
                f"{where}: expected actions (T, {num}), as in {self._first}, got "
                f"{actions.shape}; give all the same actions, or leave the demo out"
            )
        num_pictures = len(actions) if self.camera is None else len(self._pictures(file, episode))
        if num_pictures != len(actions) or len(actions) < 2:
            raise InputError(
                f"{where} has {len(actions)} actions and {num_pictures} pictures; "
                "expected as many, at least 2, a picture before each"
            )
        times_s = np.arange(len(actions)) / self.fps
        read = functools.partial(self._observation, file, episode, num_rows=len(actions))
        found = gather(readings, len(actions), read)
        return Rows(hdf5.read_floats(where, actions), times_s, float(times_s[-1]), found)

    def _pictures_at(
        self, stored: Any, episode: int, times_s: np.ndarray
    ) -> Iterator[tuple[float, np.ndarray]]:
        size = max(1, _BLOCK_BYTES // math.prod(stored.shape[1:]))
        block, first = np.empty((0,)), 0
        for row in nearest_rows(self._where(episode), times_s, self.fps, len(stored)):
            if not first <= row < first + len(block):
                first = row
                with hdf5.sound(f"{self.path}, row {row}"):
                    block = stored[row : row + size]
            yield row / self.fps, block[row - first]

    @property
    def _first(self) -> str:
        return self.episodes[self.kept[0]]

    def _where(self, episode: int) -> str:
        """The episode's name in messages."""
        return f"{self.path}: {self.episodes[episode]}"

    def _stored(self, file: Any, episode: int, key: str) -> Any:
        group = f"data/{self.episodes[episode]}"
        return hdf5.stored(self._where(episode), file, group, key)

    def _actions(self, file: Any, episode: int) -> Any:
        stored = self._stored(file, episode, "actions")
        if stored.ndim != 2 or len(stored) > MOST_ROWS or not 0 < stored.shape[1] <= MOST_ACTIONS:
            raise InputError(
                f"{self._where(episode)}: expected actions (T, A) with T up to {MOST_ROWS} and A "
                f"from 1 to {MOST_ACTIONS}, got {stored.shape}"
            )
        return stored

    def _pictures(self, file: Any, episode: int) -> Any:
        stored = self._stored(file, episode, f"obs/{self.camera}")
        if not hdf5.is_pictures(stored) or math.prod(stored.shape[1:3]) > MOST_PIXELS:
            raise InputError(
                f"{self._where(episode)}: expected obs/{self.camera} as (T, H, W, 3) uint8, "
                f"got {stored.shape} {stored.dtype}"
            )
        return stored

    def _observation(self, file: Any, episode: int, key: str, num_rows: int) -> np.ndarray:
        """(T, D) observation `key`, which must have the first used episode's width D."""
        where, stored = self._where(episode), self._stored(file, episode, f"obs/{key}")
        width = sum(reading.key == key for reading in self.readings)
        if _width(stored) != width or len(stored) != num_rows:
            raise InputError(
                f"{where}: expected obs/{key} as numbers ({num_rows}, {width}), a row an "
                f"action, got {stored.shape} {stored.dtype}"
            )
        return hdf5.read_floats(where, stored).reshape(num_rows, width)

    def _observed(self, file: Any) -> dict[str, Any]:
        """{key: dataset} of the first used episode's obs."""
        demo = file["data"][self._first]
        observed = demo.get("obs", {}) if hdf5.keys(demo) else {}
        return {key: observed.get(key) for key in hdf5.keys(observed)}

    def _choose_camera(self, observed: dict[str, Any], camera: str | None) -> str:
        """Key of the chosen camera's pictures. Raises InputError."""
        cameras = [key for key, stored in observed.items() if hdf5.is_pictures(stored)]
        if not cameras:
            raise InputError(
                f"{self.path}: no pictures (T, H, W, 3) uint8 in /data/{self._first}/obs; "
                f"there are: {short(list(observed))}"
            )
        return choose_camera(self.path, cameras, camera, "{}_image")


def _readings(key: str, stored: Any) -> list[Reading]:
    """Readings of obs/`key`; its numbers have no names."""
    return readings_of(key, (), _width(stored))


def _width(stored: Any) -> int:
    """Number of values per row of a dataset; 0 if it holds something else."""
    if getattr(getattr(stored, "dtype", None), "kind", "") not in ("f", "i", "u"):
        return 0
    width = stored.shape[1] if stored.ndim == 2 else 1
    return width if stored.ndim in (1, 2) and width <= MOST_ACTIONS else 0


def _environment(env_args: Any) -> tuple[str | None, float | None]:
    """Name and control rate of the environment from the JSON of env_args; None if unknown."""
    try:
        facts = json.loads(env_args)
        name, fps = facts.get("env_name"), facts.get("env_kwargs", {}).get("control_freq")
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None, None
    return name if isinstance(name, str) else None, float(fps) if is_rate(fps) else None
