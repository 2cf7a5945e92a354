"""A small LeRobotDataset v2.1, written as lerobot did: an episode a parquet file and an mp4."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from simtune.recordings import write_video

CAMERA = "observation.images.front"
DATA = "data/chunk-{chunk:03d}/episode_{episode:06d}.parquet"
VIDEO = "videos/chunk-{chunk:03d}/" + CAMERA + "/episode_{episode:06d}.mp4"
INFO, EPISODES = "meta/info.json", "meta/episodes.jsonl"
VIDEO_FEATURE = {"dtype": "video", "shape": [32, 32, 3], "names": ["height", "width", "channel"]}


def write_v21(
    folder: Path,
    episodes: Sequence[Mapping[str, np.ndarray]],
    names: Mapping[str, Any],
    *,
    fps: float,
    version: str = "v2.1",
    chunks_size: int = 1000,
) -> None:
    """Episodes of columns (T, D) by their names, of which "frames" (T, H, W, 3) become a video.

    `names` are those in meta/info.json, of each column.
    """
    columns = [name for name in episodes[0] if name != "frames"]
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [episodes[0][name].shape[1]], "names": names[name]}
        for name in columns
    }
    for name in ("frame_index", "episode_index", "index", "task_index", "timestamp"):
        dtype = "float32" if name == "timestamp" else "int64"
        features[name] = {"dtype": dtype, "shape": [1], "names": None}
    if "frames" in episodes[0]:
        features[CAMERA] = VIDEO_FEATURE
    (folder / "meta").mkdir(parents=True)
    first = 0
    for index, episode in enumerate(episodes):
        place = {"chunk": index // chunks_size, "episode": index}
        rows = np.arange(len(episode[columns[0]]))
        _write_rows(folder / DATA.format(**place), episode, columns, index, first + rows, fps)
        if "frames" in episode:
            path = folder / VIDEO.format(**place)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_video(path, episode["frames"], fps)
        first += len(rows)
    lines = [
        {"episode_index": i, "tasks": ["swing it"], "length": len(episode[columns[0]])}
        for i, episode in enumerate(episodes)
    ]
    (folder / EPISODES).write_text("".join(json.dumps(line) + "\n" for line in lines))
    info = {
        "codebase_version": version,
        "robot_type": "arm",
        "total_episodes": len(episodes),
        "total_frames": first,
        "chunks_size": chunks_size,
        "fps": fps,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/"
        "episode_{episode_index:06d}.mp4",
        "features": features,
    }
    (folder / INFO).write_text(json.dumps(info))


def _write_rows(
    path: Path,
    episode: Mapping[str, np.ndarray],
    columns: Sequence[str],
    index: int,
    rows: np.ndarray,
    fps: float,
) -> None:
    lists = {}
    for name in columns:
        values = np.asarray(episode[name], np.float32)
        flat = pa.array(values.ravel())
        lists[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    frame_index = rows - rows[0]
    numbers = {
        "timestamp": (frame_index / fps).astype(np.float32),
        "frame_index": frame_index,
        "episode_index": np.full_like(rows, index),
        "index": rows,
        "task_index": np.zeros_like(rows),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table({**lists, **numbers}), path)
