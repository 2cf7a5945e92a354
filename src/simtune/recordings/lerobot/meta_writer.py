"""Writes the meta folder of a LeRobotDataset v3.0: info, statistics, tasks, episodes."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from simtune.recordings.lerobot.contents import COLUMNS, FIRST, Contents, first_file
from simtune.recordings.lerobot.layout import CODEBASE_VERSION, DATA_PATH, INFO_PATH, VIDEO_PATH
from simtune.recordings.lerobot.stats import column_stats, image_stats

_EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_TASK_TEXT = "__index_level_0__"  # pandas' name for the column of an unnamed index


def write_meta(folder: Path, contents: Contents) -> None:
    """Write meta/ of a dataset with all episodes of `contents`, in the first file of each kind."""
    _write_json(first_file(folder, INFO_PATH), _info(contents))
    colours = {
        key: np.sum([counts[key] for counts in contents.colours], 0) for key in contents.widths
    }
    stats = _stats(contents.all_rows(), colours)
    _write_json(folder / "meta/stats.json", stats)

    tasks = pa.table({"task_index": [0], _TASK_TEXT: [contents.task]})
    # lerobot reads the table with pandas and expects the tasks' texts as the index.
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(_PANDAS_TASKS)})
    pq.write_table(tasks, folder / "meta/tasks.parquet")

    episodes = [_episode_row(contents, index) for index in range(len(contents.columns))]
    pq.write_table(pa.Table.from_pylist(episodes), first_file(folder, _EPISODES_PATH))


def _episode_row(contents: Contents, index: int) -> dict[str, Any]:
    """A row of meta/episodes: an episode's location and statistics."""
    columns, videos = contents.columns[index], [f"videos/{key}" for key in contents.widths]
    start, stop = int(columns["index"][0]), int(columns["index"][-1]) + 1
    row: dict[str, Any] = {
        "episode_index": index,
        "tasks": [contents.task],
        "length": stop - start,
        "dataset_from_index": start,
        "dataset_to_index": stop,
    }
    for video in videos:
        row[f"{video}/from_timestamp"] = start / contents.fps
        row[f"{video}/to_timestamp"] = stop / contents.fps
    for part in ("data", *videos, "meta/episodes"):
        row |= {f"{part}/{key}": value for key, value in FIRST.items()}
    for name, values in _stats(columns, contents.colours[index]).items():
        row |= {f"stats/{name}/{key}": value for key, value in values.items()}
    return row


def _stats(
    columns: Mapping[str, np.ndarray], colours: Mapping[str, np.ndarray]
) -> dict[str, dict[str, Any]]:
    """Statistics of rows, `columns`, and of each camera's (3, 256) histograms, `colours`."""
    num = len(columns["index"])
    pictures = {key: image_stats(counted, num) for key, counted in colours.items()}
    return pictures | {name: column_stats(values) for name, values in columns.items()}


def _info(contents: Contents) -> dict[str, Any]:
    """Content of meta/info.json."""
    num_episodes = len(contents.columns)
    features = {
        key: _video_feature(contents.height, width, contents.fps)
        for key, width in contents.widths.items()
    }
    for column in contents.columns[0]:
        features[column] = {"dtype": COLUMNS[column], "shape": [1], "names": None}
    for column, names in contents.names.items():
        features[column] |= {"shape": [len(names)], "names": names}
    return {
        "codebase_version": CODEBASE_VERSION,
        "robot_type": contents.robot_type,
        "total_episodes": num_episodes,
        "total_frames": contents.num_rows,
        "total_tasks": 1,
        # lerobot's defaults, used if someone appends to the dataset with lerobot
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": contents.fps,
        "splits": {"train": f"0:{num_episodes}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH if contents.widths else None,
        "features": features,
    }


def _video_feature(height: int, width: int, fps: float) -> dict[str, Any]:
    return {
        "dtype": "video",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": fps,
            "video.channels": 3,
            "has_audio": False,
        },
    }


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")


def _pandas_column(name: str | None, stored: str | None, kind: str, numpy: str) -> dict[str, Any]:
    kinds = {"pandas_type": kind, "numpy_type": numpy, "metadata": None}
    return {"name": name, "field_name": stored, **kinds}


_PANDAS_TASKS: dict[str, Any] = {
    "index_columns": [_TASK_TEXT],
    "column_indexes": [
        _pandas_column(None, None, "unicode", "str") | {"metadata": {"encoding": "UTF-8"}}
    ],
    "columns": [
        _pandas_column("task_index", "task_index", "int64", "int64"),
        _pandas_column(None, _TASK_TEXT, "unicode", "str"),
    ],
    "attributes": {},
    "creator": {"library": "simtune", "version": "0"},
    "pandas_version": "2.0.0",
}
