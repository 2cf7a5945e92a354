"""Write trajectories as a LeRobotDataset v3.0, laid out as the lerobot package does it."""

import itertools
import json
import os
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from simtune.errors import InputError
from simtune.recordings.lerobot_format import (
    CODEBASE_VERSION,
    DATA_PATH,
    DEFAULT_CAMERA,
    EPISODES_PATH,
    INFO_PATH,
    STATS_PATH,
    TASKS_PATH,
    VIDEO_PATH,
)
from simtune.recordings.lerobot_stats import column_stats, count_colours, image_stats
from simtune.recordings.video_writer import VideoWriter
from simtune.trajectory import Trajectory

KEYFRAME_INTERVAL = 2  # lerobot's default: training on the dataset seeks all the time
CRF = 18  # lerobot takes 30, which blurs what little detail small pictures have
PLACE = {"chunk_index": 0, "file_index": 0}  # everything goes into the first file of its kind


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
        raise InputError(f"{folder}: exists already and is not empty; choose another name")
    trajectories = iter(trajectories)
    first = next(trajectories, None)
    if first is None:
        raise ValueError("a dataset needs at least one trajectory")
    folder.parent.mkdir(parents=True, exist_ok=True)
    unfinished = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        contents = _Contents(
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
        _write_meta(unfinished, contents)
        os.replace(unfinished, folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


@dataclass(kw_only=True)
class _Contents:
    """What goes into the dataset, but for its frames."""

    step_s: float
    image_size: tuple[int, int]  # (height, width), pixels
    action_names: tuple[str, ...]
    robot_type: str
    task: str
    camera: str
    columns: list[dict[str, np.ndarray]] = field(default_factory=list)  # an episode's rows
    colours: list[np.ndarray] = field(default_factory=list)  # an episode's histogram (3, 256)

    @property
    def fps(self) -> float:
        """Rows a second; an int where it is whole, as lerobot wants it."""
        fps = 1 / self.step_s
        return round(fps) if abs(fps - round(fps)) < 1e-6 * fps else fps

    @property
    def num_rows(self) -> int:
        return sum(len(columns["index"]) for columns in self.columns)

    def add(self, trajectory: Trajectory) -> None:
        """Note an episode's rows and colours."""
        actions = np.concatenate([trajectory.actions, trajectory.actions[-1:]])
        frame_index = np.arange(len(actions))
        self.colours.append(count_colours(trajectory.frames))
        self.columns.append(
            {
                "action": actions.astype(np.float32),
                "timestamp": (frame_index / self.fps).astype(np.float32),
                "frame_index": frame_index,
                "episode_index": np.full(len(actions), len(self.columns)),
                "index": frame_index + self.num_rows,
                "task_index": np.zeros(len(actions), np.int64),
            }
        )

    def check(self, trajectory: Trajectory) -> None:
        """Raise ValueError where the trajectory does not fit the dataset."""
        episode, num_actions = len(self.columns), trajectory.actions.shape[1]
        if len(trajectory) == 0 or num_actions != len(self.action_names):
            raise ValueError(
                f"trajectory {episode}: expected actions (T, {len(self.action_names)}), T >= 1, "
                f"got {trajectory.actions.shape}"
            )
        if not np.isfinite(trajectory.actions).all():
            raise ValueError(f"trajectory {episode}: actions are not all finite")
        if trajectory.frames.shape[1:3] != self.image_size or trajectory.step_s != self.step_s:
            raise ValueError(
                f"trajectory {episode}: expected frames of {self.image_size} pixels every "
                f"{self.step_s} s as in the first one, got {trajectory.frames.shape[1:3]} every "
                f"{trajectory.step_s} s"
            )


def _write_video(
    folder: Path, contents: _Contents, trajectories: Iterable[Trajectory], crf: int
) -> None:
    path = _place(folder, VIDEO_PATH, video_key=contents.camera)
    with VideoWriter(path, contents.fps, crf=crf, keyframe_interval=KEYFRAME_INTERVAL) as video:
        for trajectory in trajectories:
            contents.check(trajectory)
            contents.add(trajectory)
            for frame in trajectory.frames:
                video.write(frame)


def _write_data(folder: Path, contents: _Contents) -> None:
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
    pq.write_table(table, _place(folder, DATA_PATH))


def _write_meta(folder: Path, contents: _Contents) -> None:
    _write_json(_place(folder, INFO_PATH), _info(contents))
    stats = {contents.camera: image_stats(np.sum(contents.colours, 0), contents.num_rows)}
    for name in contents.columns[0]:
        stats[name] = column_stats(_rows(name, *contents.columns))
    _write_json(_place(folder, STATS_PATH), stats)

    tasks = pa.table({"task_index": [0], "__index_level_0__": [contents.task]})
    # lerobot reads it with pandas and expects the tasks' texts as the index.
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(_PANDAS_TASKS)})
    pq.write_table(tasks, _place(folder, TASKS_PATH))

    episodes = pa.Table.from_pylist(_episode_rows(contents))
    pq.write_table(episodes, _place(folder, EPISODES_PATH))


def _episode_rows(contents: _Contents) -> list[dict[str, Any]]:
    """The rows of meta/episodes: where each episode lies, and its statistics."""
    rows = []
    for index, columns in enumerate(contents.columns):
        start, stop = int(columns["index"][0]), int(columns["index"][-1]) + 1
        row: dict[str, Any] = {
            "episode_index": index,
            "tasks": [contents.task],
            "length": stop - start,
            "data/chunk_index": PLACE["chunk_index"],
            "data/file_index": PLACE["file_index"],
            "dataset_from_index": start,
            "dataset_to_index": stop,
            f"videos/{contents.camera}/chunk_index": PLACE["chunk_index"],
            f"videos/{contents.camera}/file_index": PLACE["file_index"],
            f"videos/{contents.camera}/from_timestamp": start / contents.fps,
            f"videos/{contents.camera}/to_timestamp": stop / contents.fps,
        }
        stats = {contents.camera: image_stats(contents.colours[index], stop - start)}
        stats |= {name: column_stats(_rows(name, columns)) for name in columns}
        for name, values in stats.items():
            row |= {f"stats/{name}/{key}": value for key, value in values.items()}
        row |= {f"meta/episodes/{key}": value for key, value in PLACE.items()}
        rows.append(row)
    return rows


def _info(contents: _Contents) -> dict[str, Any]:
    """meta/info.json."""
    height, width = contents.image_size
    num_episodes = len(contents.columns)
    features: dict[str, Any] = {
        contents.camera: {
            "dtype": "video",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": height,
                "video.width": width,
                "video.codec": "h264",
                "video.pix_fmt": "yuv420p",
                "video.is_depth_map": False,
                "video.fps": contents.fps,
                "video.channels": 3,
                "has_audio": False,
            },
        },
        "action": {
            "dtype": "float32",
            "shape": [len(contents.action_names)],
            "names": list(contents.action_names),
        },
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    for name in ("frame_index", "episode_index", "index", "task_index"):
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    return {
        "codebase_version": CODEBASE_VERSION,
        "robot_type": contents.robot_type,
        "total_episodes": num_episodes,
        "total_frames": contents.num_rows,
        "total_tasks": 1,
        # lerobot's defaults, for those who append to the dataset with it.
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": contents.fps,
        "splits": {"train": f"0:{num_episodes}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "features": features,
    }


def _rows(name: str, *episodes: dict[str, np.ndarray]) -> np.ndarray:
    """A column of some episodes, (rows, A)."""
    values = np.concatenate([columns[name] for columns in episodes])
    return values.reshape(len(values), -1)


def _place(folder: Path, template: str, **names: str) -> Path:
    """Where a file goes; its folder is made."""
    path = folder / template.format(**PLACE, **names)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")


_PANDAS_TASKS: dict[str, Any] = {
    "index_columns": ["__index_level_0__"],
    "column_indexes": [
        {
            "name": None,
            "field_name": None,
            "pandas_type": "unicode",
            "numpy_type": "str",
            "metadata": {"encoding": "UTF-8"},
        }
    ],
    "columns": [
        {
            "name": "task_index",
            "field_name": "task_index",
            "pandas_type": "int64",
            "numpy_type": "int64",
            "metadata": None,
        },
        {
            "name": None,
            "field_name": "__index_level_0__",
            "pandas_type": "unicode",
            "numpy_type": "str",
            "metadata": None,
        },
    ],
    "attributes": {},
    "creator": {"library": "simtune", "version": "0"},
    "pandas_version": "2.0.0",
}
