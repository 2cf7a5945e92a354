"""Write trajectories as a LeRobotDataset v3.0, laid out as the lerobot package does it."""

import itertools
import json
import os
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from simtune.errors import InputError
from simtune.recordings.lerobot_contents import Contents
from simtune.recordings.lerobot_format import DATA_PATH, DEFAULT_CAMERA, VIDEO_PATH, first_file
from simtune.recordings.lerobot_meta_writer import write_meta
from simtune.recordings.video_writer import VideoWriter
from simtune.trajectory import Trajectory

KEYFRAME_INTERVAL = 2  # lerobot's default: training on the dataset seeks all the time
CRF = 18  # lerobot takes 30, which blurs what little detail small pictures have


def write_dataset(
    folder: str | Path,
    trajectories: Iterable[Trajectory],
    *,
    action_names: Sequence[str],
    robot_type: str,
    task: str,
    camera: str = DEFAULT_CAMERA,
    crf: int = CRF,
) -> None:
    """Write trajectories, one an episode, as a LeRobotDataset v3.0 with one camera (h264).

    A trajectory of T actions becomes T + 1 rows, one a frame; the last row's action, of which
    no frame shows the outcome, repeats the one before. Trajectories are taken one at a time, so
    a generator needs memory for one only. `task` says in words what is done, `crf` is x264's
    quality (less is better). All episodes share one mp4 and one parquet file.

    The folder appears whole or not at all: it is written beside its place and then renamed.

    Raises:
        InputError: the folder exists and is not empty, or the pictures have an odd side.
        ValueError: there is no trajectory, or they do not fit together or `action_names`.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = "is not empty" if folder.is_dir() else "is a file"
        raise InputError(f"{folder}: exists already and {what}; choose another name")
    unfinished = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:  # before anything is filmed
        shutil.rmtree(unfinished, ignore_errors=True)  # of one that was killed
        unfinished.mkdir(parents=True)
        unfinished.rmdir()
    except OSError as error:
        raise InputError(
            f"cannot write into {folder.parent}: {error.strerror}; choose another place"
        ) from None
    trajectories = iter(trajectories)
    first = next(trajectories, None)
    if first is None:
        raise ValueError("a dataset needs at least one trajectory")
    try:
        contents = Contents(
            step_s=first.step_s,
            image_size=(first.frames.shape[1], first.frames.shape[2]),
            action_names=tuple(action_names),
            robot_type=robot_type,
            task=task,
            camera=camera,
        )
        if contents.image_size[0] % 2 or contents.image_size[1] % 2:
            raise InputError(
                f"{folder}: pictures of {contents.image_size[0]}×{contents.image_size[1]} pixels "
                "do not fit h264 video; choose an even height and width"
            )
        _write_video(unfinished, contents, itertools.chain([first], trajectories), crf)
        _write_data(unfinished, contents)
        write_meta(unfinished, contents)
        os.replace(unfinished, folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _write_video(
    folder: Path, contents: Contents, trajectories: Iterable[Trajectory], crf: int
) -> None:
    path = first_file(folder, VIDEO_PATH, video_key=contents.camera)
    with VideoWriter(path, contents.fps, crf=crf, keyframe_interval=KEYFRAME_INTERVAL) as video:
        for trajectory in trajectories:
            contents.check(trajectory)
            contents.add(trajectory)
            for frame in trajectory.frames:
                video.write(frame)


def _write_data(folder: Path, contents: Contents) -> None:
    num_actions = len(contents.action_names)
    scalar = {"dtype": "float32", "_type": "Value"}
    features: dict[str, Any] = {
        # lerobot stores features of one number as plain numbers.
        "action": scalar
        if num_actions == 1
        else {"feature": scalar, "length": num_actions, "_type": "List"},
        "timestamp": scalar,
    }
    for name in ("frame_index", "episode_index", "index", "task_index"):
        features[name] = {"dtype": "int64", "_type": "Value"}
    arrays = {}
    for name in features:
        values = np.concatenate([columns[name] for columns in contents.columns])
        arrays[name] = pa.array(values.ravel())
    if num_actions > 1:
        arrays["action"] = pa.FixedSizeListArray.from_arrays(
            arrays["action"], type=pa.list_(pa.field("element", pa.float32()), num_actions)
        )
    # Hugging Face's `datasets` reads the features from here.
    metadata = {"huggingface": json.dumps({"info": {"features": features}})}
    table = pa.table(arrays).replace_schema_metadata(metadata)
    pq.write_table(table, first_file(folder, DATA_PATH))
