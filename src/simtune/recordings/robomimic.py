"""robomimic's HDF5: /data/demo_i with actions and pictures, which are stored one by one."""

import contextlib
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.recordings.source import MOST_ACTIONS, MOST_ROWS, Rows, choose_camera, is_rate, short
from simtune.recordings.video import MOST_PIXELS

_BLOCK_BYTES = 1 << 24  # of pictures read at once: compressed ones are stored several together
_MOST_CHUNK_BYTES = 1 << 28  # a chunk is unpacked whole


class RobomimicSource:
    """A file of robomimic's layout. Row t is a picture and the action applied after it.

    `fps`, where given, stands in for the rate that a file without env_args does not say.
    Raises InputError where the file is none such, or h5py is not installed.
    """

    kind = "robomimic HDF5"
    codec = "raw"

    def __init__(self, path: Path, camera: str | None = None, fps: float | None = None):
        self.path = path
        self.files: Sequence[Path] = [path]
        self._file = _open(path)
        with _sound(path):
            data = self._file.get("data", {})
            names = [name for name in _keys(data) if name.startswith("demo_")]
            if not names:
                raise InputError(f"{path}: holds no episode; expected groups /data/demo_0, ...")
            self.episodes: Sequence[str] = sorted(names, key=lambda name: (len(name), name))
            self.robot_type, own_fps = _environment(data.attrs.get("env_args"))
            self.camera = self._choose_camera(camera)
        self.action_names = tuple(f"action_{i}" for i in range(self._actions(0).shape[1]))
        self.fps = own_fps or fps or 0.0
        if not self.fps:
            raise InputError(
                f"{path}: /data says no control_freq in env_args; give the rate as --control-hz"
            )

    def rows(self, episode: int) -> Rows:
        stored, pictures = self._actions(episode), self._pictures(episode)
        if len(pictures) != len(stored) or len(stored) < 2:
            raise InputError(
                f"{self.path}: {self.episodes[episode]} has {len(stored)} actions and "
                f"{len(pictures)} pictures; expected as many, at least 2, a picture before each"
            )
        with _sound(f"{self.path}: {self.episodes[episode]}"):
            actions = np.asarray(stored[()], np.float64)
        times_s = np.arange(len(actions)) / self.fps
        return Rows(actions, times_s, float(times_s[-1]))

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        stored = self._pictures(episode)
        size = max(1, _BLOCK_BYTES // math.prod(stored.shape[1:]))
        block, first = np.empty((0,)), 0
        for row in np.rint(times_s * self.fps).astype(int).clip(max=len(stored) - 1):
            if not first <= row < first + len(block):
                first = row
                with _sound(f"{self.path}, row {row}"):
                    block = stored[row : row + size]
            yield row / self.fps, block[row - first]

    def _actions(self, episode: int) -> Any:
        where, stored = self._dataset(episode, "actions")
        if stored.ndim != 2 or len(stored) > MOST_ROWS or not 0 < stored.shape[1] <= MOST_ACTIONS:
            raise InputError(
                f"{where}: expected actions (T, A) with T up to {MOST_ROWS} and A from 1 to "
                f"{MOST_ACTIONS}, got {stored.shape}"
            )
        return stored

    def _pictures(self, episode: int) -> Any:
        where, stored = self._dataset(episode, f"obs/{self.camera}")
        if not _is_pictures(stored) or math.prod(stored.shape[1:3]) > MOST_PIXELS:
            raise InputError(
                f"{where}: expected obs/{self.camera} as (T, H, W, 3) uint8, "
                f"got {stored.shape} {stored.dtype}"
            )
        return stored

    def _dataset(self, episode: int, key: str) -> tuple[str, Any]:
        """How messages call an episode, and its HDF5 dataset: in this file, of a size to read."""
        where = f"{self.path}: {self.episodes[episode]}"
        with _sound(where):
            group = self._file["data"][self.episodes[episode]]
            stored: Any = group.get(key) if _keys(group) else None
            if not hasattr(stored, "shape"):
                raise InputError(f"{where} has no {key}; there are: {short(_keys(group))}")
            # An HDF5 file can borrow from any file that its reader may read.
            if stored.file.filename != self._file.filename or stored.external or stored.is_virtual:
                raise InputError(f"{where}: {key} leads out of the file")
            chunk_bytes = math.prod(stored.chunks or ()) * stored.dtype.itemsize
            if chunk_bytes > _MOST_CHUNK_BYTES:
                raise InputError(
                    f"{where}: {key} is stored in chunks of {chunk_bytes / 1e6:.0f} MB; "
                    "expected some pictures each, write the file anew"
                )
            return where, stored

    def _choose_camera(self, camera: str | None) -> str:
        """The key of the chosen camera's pictures, by what the first episode holds."""
        demo = self._file["data"][self.episodes[0]]
        observed = demo.get("obs", {}) if _keys(demo) else {}
        cameras = [key for key in _keys(observed) if _is_pictures(observed.get(key))]
        if not cameras:
            raise InputError(
                f"{self.path}: no pictures (T, H, W, 3) uint8 in /data/{self.episodes[0]}/obs; "
                f"there are: {short(_keys(observed))}"
            )
        return choose_camera(self.path, cameras, camera, "{}_image")


def _open(path: Path) -> Any:
    try:
        import h5py
    except ImportError:
        raise InputError(f"{path}: reading HDF5 needs h5py: pip install h5py") from None
    with _sound(path):
        return h5py.File(path, "r")


def _keys(group: Any) -> list[str]:
    """Of a group; of what should be one and is not, none."""
    return list(group) if hasattr(group, "keys") else []


def _is_pictures(stored: Any) -> bool:
    shape = getattr(stored, "shape", ())
    return len(shape) == 4 and shape[3] == 3 and stored.dtype == np.uint8


def _environment(env_args: Any) -> tuple[str | None, float | None]:
    """Name and control rate of the environment, where the JSON of env_args says them."""
    try:
        said = json.loads(env_args)
        name, fps = said.get("env_name"), said.get("env_kwargs", {}).get("control_freq")
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None, None
    return name if isinstance(name, str) else None, float(fps) if is_rate(fps) else None


@contextlib.contextmanager
def _sound(where: object) -> Iterator[None]:
    """What h5py raises for damaged files, as an InputError."""
    try:
        yield
    except InputError:
        raise
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else "damaged"
        raise InputError(f"{where}: not readable as HDF5 ({reason}); copy the file again") from None
