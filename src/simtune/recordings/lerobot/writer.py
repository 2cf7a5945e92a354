"""Writes trajectories as a LeRobotDataset v3.0, in the layout of the lerobot package."""

import itertools
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from simtune.errors import InputError
from simtune.recordings.lerobot.contents import CAMERA, COLUMNS, Contents, first_file
from simtune.recordings.lerobot.layout import DATA_PATH, IMAGES_PREFIX, VIDEO_PATH
from simtune.recordings.lerobot.meta_writer import write_meta
from simtune.recordings.readings import NO_READINGS
from simtune.recordings.source import short
from simtune.recordings.video_writer import VideoWriter
from simtune.trajectory import Trajectory

_KEYFRAME_INTERVAL = 2  # lerobot's default: training on the dataset seeks often
_CRF = 18  # lerobot uses 30, which blurs the little detail of small pictures


def write_dataset(
    folder: str | Path,
    trajectories: Iterable[Trajectory],
    *,
    action_names: Sequence[str],
    robot_type: str,
    task: str,
    reading_names: Mapping[str, Sequence[str]] = NO_READINGS,
    widths: Mapping[str, int] | None = None,
    crf: int = _CRF,
) -> None:
    """Write trajectories, one per episode, as a LeRobotDataset v3.0 (h264).

    The readings of the sensors in `reading_names`, {sensor: names of its numbers}, become the
    feature "observation.state" (float32), one sensor after the other; other readings are left out.

    `widths`, {camera: pixels}, are the widths of the views that frames show side by side, by
    default of one "camera0"; each view becomes a video. Without pictures there is no camera.

    A trajectory of T actions becomes T + 1 rows, one per frame; the last row repeats the action
    before it, since no frame shows the outcome of another one. Trajectories are read one at a time,
    so a generator needs memory for one only. `task` describes the task in words, `crf` is x264's
    quality (less is better). All episodes share one mp4 per camera and one parquet file.

    The folder is written completely or not at all: it is written beside its place, then moved. Into
    an empty folder its parts are moved one by one, and `meta`, without which it is none, last.

    Raises:
        InputError: the folder exists and is not empty, or the pictures have an odd side.
        ValueError: there is no trajectory, or trajectories do not fit each other or the names.
    """
    with _whole_or_not_at_all(Path(folder)) as unfinished:
        trajectories = iter(trajectories)
        first = next(trajectories, None)
        if first is None:
            raise ValueError("a dataset needs at least one trajectory")
        _check_names(reading_names)
        height, width = first.frames.shape[1:3]
        cameras = widths or ({CAMERA: width} if width else {})
        if odd := [(height, w) for w in cameras.values() if height % 2 or w % 2]:
            raise InputError(
                f"{folder}: pictures of {odd[0][0]}×{odd[0][1]} pixels "
                "do not fit h264 video; choose an even height and width"
            )
        contents = Contents(
            step_s=first.step_s,
            height=height,
            widths={f"{IMAGES_PREFIX}{name}": pixels for name, pixels in cameras.items()},
            action_names=tuple(action_names),
            reading_names=reading_names,
            robot_type=robot_type,
            task=task,
        )
        trajectories = itertools.chain([first], trajectories)
        _write_videos(unfinished, contents, trajectories, crf)
        _write_data(unfinished, contents)
        write_meta(unfinished, contents)


def _check_names(reading_names: Mapping[str, Sequence[str]]) -> None:
    names = [name for of_sensor in reading_names.values() for name in of_sensor]
    if len(set(names)) < len(names) or not all(reading_names.values()):
        raise ValueError(f"each sensor needs names, and no two the same, got {short(names)}")


@contextmanager
def _whole_or_not_at_all(folder: Path) -> Iterator[Path]:
    """A temporary folder, moved to `folder` at the end. Raises InputError if that is not empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = "is not empty" if folder.is_dir() else "is a file"
        raise InputError(f"{folder}: exists already and {what}; choose another name")
    folder = folder.resolve()  # "." has no name, and a link's target may be on another disk
    unfinished = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:  # fails before anything is filmed
        shutil.rmtree(unfinished, ignore_errors=True)  # left by a killed process
        unfinished.mkdir(parents=True)
    except OSError as error:
        raise InputError(
            f"cannot write into {folder.parent}: {error.strerror}; choose another place"
        ) from None
    try:
        yield unfinished
        if folder.exists():  # filled, not replaced: it may be the one that the user's shell is in
            for part in sorted(unfinished.iterdir(), key=lambda part: part.name == "meta"):
                os.replace(part, folder / part.name)
        else:
            os.replace(unfinished, folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _write_videos(
    folder: Path, contents: Contents, trajectories: Iterable[Trajectory], crf: int
) -> None:
    with ExitStack() as open_ones:
        videos = {}
        for key in contents.widths:
            path = first_file(folder, VIDEO_PATH, video_key=key)
            video = VideoWriter(path, contents.fps, crf=crf, keyframe_interval=_KEYFRAME_INTERVAL)
            videos[key] = open_ones.enter_context(video)
        for trajectory in trajectories:
            contents.add(trajectory)
            for key, frames in contents.views(trajectory.frames).items():
                for frame in frames:
                    videos[key].write(frame)


def _write_data(folder: Path, contents: Contents) -> None:
    features: dict[str, Any] = {
        name: {"dtype": COLUMNS[name], "_type": "Value"} for name in contents.columns[0]
    }
    arrays = {name: pa.array(values.ravel()) for name, values in contents.all_rows().items()}
    for name, names in contents.names.items():
        if len(names) > 1:  # lerobot stores features of one number as plain numbers
            values = pa.list_(pa.field("element", pa.float32()), len(names))
            arrays[name] = pa.FixedSizeListArray.from_arrays(arrays[name], type=values)
            features[name] = {"feature": features[name], "length": len(names), "_type": "List"}
    # Hugging Face's `datasets` reads the features from here.
    metadata = {"huggingface": json.dumps({"info": {"features": features}})}
    table = pa.table(arrays).replace_schema_metadata(metadata)
    pq.write_table(table, first_file(folder, DATA_PATH))
