"""Opens recordings of any kind; the kind is recognised by the files."""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path

from simtune.cameras.footage import PLAIN, Footage
from simtune.errors import InputError
from simtune.recordings.arrays import ENDING as ARRAYS
from simtune.recordings.arrays import ArraysSource, holds_episodes
from simtune.recordings.dataset import Dataset
from simtune.recordings.film import Film, Shot
from simtune.recordings.lerobot import INFO_PATH, LeRobotSource
from simtune.recordings.pairs import TABLE, VIDEOS, PairsSource
from simtune.recordings.readings import NO_READINGS
from simtune.recordings.robomimic import RobomimicSource
from simtune.recordings.source import Source, short
from simtune.recordings.turning import Turning

# Endings of files, in small letters or large
_HDF5 = (".hdf5", ".h5")
_BAGS = (".mcap", ".db3", ".bag")


def open_dataset(
    path: str | Path,
    *,
    cameras: Sequence[Footage] = (PLAIN,),
    image_size: int | None = None,
    num_actions: int | None = None,
    actions: Sequence[str] | None = None,
    control_hz: float | None = None,
    leave_out: Sequence[str] = (),
    readings: Mapping[str, Sequence[str]] = NO_READINGS,
    turnings: Sequence[Turning] = (),
) -> Dataset:
    """Open a LeRobotDataset v3.0 or v2, robomimic's HDF5, or a folder of arrays or of pairs.

    Only the description of the episodes is read and checked, no pictures. `cameras`: the cameras to
    use; a key of None means the recordings' only camera. Episodes named in `leave_out` are not
    used, nor looked at. For the other arguments see `Dataset`.

    Raises:
        InputError: it is none of these kinds, or unsound; one line says what was expected.
    """
    path = Path(path)
    recognise = functools.partial(_recognise, path, control_hz=control_hz, leave_out=leave_out)
    shots = [Shot(recognise(f.key, pictures=True), f) for f in cameras]
    rows = shots[0].source if shots else recognise(None, pictures=False)
    return Dataset(
        rows,
        film=Film(shots, str(path)) if shots else None,
        image_size=image_size,
        num_actions=num_actions,
        actions=actions,
        control_hz=control_hz,
        readings=readings,
        turnings=turnings,
    )


def _recognise(
    path: Path,
    camera: str | None,
    *,
    control_hz: float | None,
    pictures: bool,
    leave_out: Sequence[str],
) -> Source:
    if path.is_file() and path.suffix.lower() in _HDF5:
        return RobomimicSource(path, camera, control_hz, pictures=pictures, leave_out=leave_out)
    if path.is_file() and path.suffix.lower() in _BAGS:
        raise _is_bag(path)
    names = _listed(path)
    if (path / INFO_PATH).is_file():
        return LeRobotSource(path, camera, pictures=pictures, leave_out=leave_out)
    if hdf5 := [name for name in names if name.lower().endswith(_HDF5)]:
        if len(hdf5) > 1:
            raise InputError(f"{path}: has several HDF5 files, give one of them: {short(hdf5)}")
        return RobomimicSource(
            path / hdf5[0], camera, control_hz, pictures=pictures, leave_out=leave_out
        )
    are_pairs = any(name.lower().endswith((*VIDEOS, TABLE)) for name in names)
    has_arrays = any(name.lower().endswith(ARRAYS) for name in names)
    if has_arrays and (not are_pairs or holds_episodes(path)):
        return ArraysSource(path, camera, pictures=pictures, leave_out=leave_out)
    if are_pairs:
        return PairsSource(path, camera, pictures=pictures, leave_out=leave_out)
    if any(file.suffix.lower() in _BAGS for file in (*path.glob("*"), *path.glob("*/*"))):
        raise _is_bag(path)
    raise InputError(
        f"{path}: no recordings; looked for {INFO_PATH} (LeRobotDataset), *.hdf5 "
        "(robomimic), *.npz and pairs of NAME.mp4 and NAME.csv, see docs/recordings.md; "
        + (f"it holds: {short(names)}" if names else "it is empty")
    )


def _is_bag(path: Path) -> InputError:
    return InputError(
        f"{path}: a ROS bag, which simtune does not read: make a CSV of each; the code is in "
        "docs/recordings.md, under 'From a ROS 2 bag'"
    )


def _listed(path: Path) -> list[str]:
    try:
        return sorted(entry.name for entry in path.iterdir() if not entry.name.startswith("."))
    except FileNotFoundError:
        raise InputError(f"{path}: no such folder; expected a folder of recordings") from None
    except NotADirectoryError:
        raise InputError(f"{path}: is a file; expected a folder of recordings") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
