"""Write the meta folder of a LeRobotDataset v3.0: info, statistics, tasks, episodes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from simtune.recordings.lerobot_contents import Contents
from simtune.recordings.lerobot_format import (
    CODEBASE_VERSION,
    DATA_PATH,
    EPISODES_PATH,
    FIRST,
    INFO_PATH,
    STATS_PATH,
    TASKS_PATH,
    VIDEO_PATH,
    first_file,
)
from simtune.recordings.lerobot_stats import column_stats, image_stats


def write_meta(folder: Path, contents: Contents) -> None:
    """Of a dataset whose episodes are all in `contents`, in the first file of each kind."""
    _write_json(first_file(folder, INFO_PATH), _info(contents))
    stats = {contents.camera: image_stats(np.sum(contents.colours, 0), contents.num_rows)}
    for name in contents.columns[0]:
        stats[name] = column_stats(_rows(name, *contents.columns))
    _write_json(first_file(folder, STATS_PATH), stats)

    tasks = pa.table({"task_index": [0], "__index_level_0__": [contents.task]})
    # lerobot reads it with pandas and expects the tasks' texts as the index.
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(_PANDAS_TASKS)})
    pq.write_table(tasks, first_file(folder, TASKS_PATH))

    episodes = pa.Table.from_pylist(_episode_rows(contents))
    pq.write_table(episodes, first_file(folder, EPISODES_PATH))


def _episode_rows(contents: Contents) -> list[dict[str, Any]]:
    """The rows of meta/episodes: where each episode lies, and its statistics."""
    rows = []
    for index, columns in enumerate(contents.columns):
        start, stop = int(columns["index"][0]), int(columns["index"][-1]) + 1
        row: dict[str, Any] = {
            "episode_index": index,
            "tasks": [contents.task],
            "length": stop - start,
            "data/chunk_index": FIRST["chunk_index"],
            "data/file_index": FIRST["file_index"],
            "dataset_from_index": start,
            "dataset_to_index": stop,
            f"videos/{contents.camera}/chunk_index": FIRST["chunk_index"],
            f"videos/{contents.camera}/file_index": FIRST["file_index"],
            f"videos/{contents.camera}/from_timestamp": start / contents.fps,
            f"videos/{contents.camera}/to_timestamp": stop / contents.fps,
        }
        stats = {contents.camera: image_stats(contents.colours[index], stop - start)}
        stats |= {name: column_stats(_rows(name, columns)) for name in columns}
        for name, values in stats.items():
            row |= {f"stats/{name}/{key}": value for key, value in values.items()}
        row |= {f"meta/episodes/{key}": value for key, value in FIRST.items()}
        rows.append(row)
    return rows


def _info(contents: Contents) -> dict[str, Any]:
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
