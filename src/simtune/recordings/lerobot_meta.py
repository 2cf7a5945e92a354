"""What a LeRobotDataset v3.0 says of itself: meta/ read and checked, no frame decoded."""

import hashlib
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

import pyarrow as pa
import pyarrow.parquet as pq

from simtune.errors import InputError, UnknownName
from simtune.recordings.lerobot_format import (
    DATA_PATH,
    IMAGES_PREFIX,
    INFO_PATH,
    VIDEO_PATH,
)


@dataclass(frozen=True, kw_only=True)
class Episode:
    """Where one episode lies."""

    index: int
    num_rows: int
    data_file: Path
    video_file: Path
    from_s: float  # where it starts in its video file, seconds


@dataclass(frozen=True, kw_only=True)
class DatasetMeta:
    """A dataset's description, as read by `read_meta`."""

    folder: Path
    fps: float
    camera: str  # key of the chosen camera
    num_actions: int
    action_names: tuple[str, ...]
    robot_type: str | None
    episodes: tuple[Episode, ...]  # by index


def read_meta(
    folder: str | Path, *, camera: str | None = None, num_actions: int | None = None
) -> DatasetMeta:
    """Read and check meta/ of a LeRobotDataset v3.0.

    `camera` is a video key, "observation.images." left off if you like; it may be None where
    there is only one. `num_actions`, where given, is the action size that the task needs.

    Raises:
        InputError: the folder is no sound v3.0 dataset; the message says why and what to do.
        UnknownName: there is no such camera.
    """
    folder = Path(folder)
    info = _read_info(folder)
    fps = info.get("fps")
    if not _is_number(fps) or fps <= 0:
        raise InputError(f"{folder / INFO_PATH}: fps must be a positive number, got {fps!r}")
    features = info.get("features")
    if not isinstance(features, dict):
        raise InputError(f"{folder / INFO_PATH}: expected an object 'features', got {features!r}")
    action_size, action_names = _action_feature(folder, features)
    if num_actions is not None and action_size != num_actions:
        raise InputError(
            f"{folder}: the task takes {num_actions} actions, the recording has {action_size} "
            f"({', '.join(action_names)}); is it of another robot?"
        )
    camera = _choose_camera(folder, features, camera)
    robot_type = info.get("robot_type")
    return DatasetMeta(
        folder=folder,
        fps=float(fps),
        camera=camera,
        num_actions=action_size,
        action_names=action_names,
        robot_type=robot_type if isinstance(robot_type, str) else None,
        episodes=_read_episodes(folder, info, camera),
    )


def dataset_hash(folder: str | Path) -> str:
    """SHA-256 over the names and contents of all files under meta/ and data/, as hex."""
    digest = hashlib.sha256()
    folder = Path(folder)
    paths = [path for part in ("meta", "data") for path in (folder / part).rglob("*")]
    for path in sorted(paths):
        if path.is_file():
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
            digest.update(f"{path.relative_to(folder).as_posix()}\n{content}\n".encode())
    return digest.hexdigest()


def read_table(path: Path, columns: list[str]) -> pa.Table:
    """Columns of a parquet file; InputError where it, or one of them, is missing or damaged."""
    if not path.is_file():
        raise InputError(f"{path}: missing, though the dataset's meta files name it")
    try:
        there = pq.read_schema(path).names
        missing = [column for column in columns if column not in there]
        if missing:
            raise InputError(
                f"{path}: no column {missing[0]!r}; there are: {', '.join(_short(there))}"
            )
        return pq.read_table(path, columns=columns)
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0].rstrip(". ") if str(error) else "damaged"
        raise InputError(
            f"{path}: not a readable parquet file ({reason}); copy the file again"
        ) from None


def _read_info(folder: Path) -> dict[str, Any]:
    """meta/info.json of a v3 dataset."""
    try:
        names = sorted(os.listdir(folder))
    except FileNotFoundError:
        raise InputError(f"{folder}: no such folder; expected a LeRobotDataset v3.0") from None
    except NotADirectoryError:
        raise InputError(
            f"{folder}: is a file; expected the folder of a LeRobotDataset v3.0"
        ) from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror})") from None
    path = folder / INFO_PATH
    if not path.is_file():
        if not names:
            raise InputError(f"{folder}: is empty; expected a LeRobotDataset v3.0")
        hint = ""
        if any(name.endswith((".mp4", ".mov", ".avi", ".mkv", ".webm")) for name in names):
            hint = "; a video alone is not enough, the actions are needed with it"
        raise InputError(
            f"{folder}: not a LeRobotDataset, {INFO_PATH} is missing; "
            f"it holds: {', '.join(_short(names))}{hint}"
        )
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(info, dict):
        raise InputError(f"{path}: expected a JSON object, got {type(info).__name__}")
    version = info.get("codebase_version")
    if not isinstance(version, str) or not (version == "v3" or version.startswith("v3.")):
        raise InputError(
            f"{path}: expected codebase_version v3.0, got {version!r}; "
            "convert the dataset with lerobot's convert_dataset_v21_to_v30"
        )
    return info


def _action_feature(folder: Path, features: dict[str, Any]) -> tuple[int, tuple[str, ...]]:
    """Size and names of the action."""
    if "action" not in features:
        raise InputError(
            f"{folder}: no column 'action', and without actions nothing can be replayed; "
            f"there are: {', '.join(_short(list(features)))}"
        )
    feature = features["action"] if isinstance(features["action"], dict) else {}
    shape = feature.get("shape")
    if not (
        isinstance(shape, list)
        and len(shape) == 1
        and isinstance(shape[0], int)
        and not isinstance(shape[0], bool)
        and shape[0] > 0
    ):
        raise InputError(
            f"{folder / INFO_PATH}: expected a shape [A] of 'action' with A >= 1, got {shape!r}"
        )
    names = feature.get("names")
    if isinstance(names, dict):  # {"motors": [...]}, as older recordings have it
        names = [name for group in names.values() for name in _as_list(group)]
    names = tuple(str(name) for name in _as_list(names))
    if len(names) != shape[0]:
        names = tuple(f"action_{index}" for index in range(shape[0]))
    return shape[0], names


def _choose_camera(folder: Path, features: dict[str, Any], camera: str | None) -> str:
    """The chosen camera's key."""
    dtypes = {
        key: feature.get("dtype") for key, feature in features.items() if isinstance(feature, dict)
    }
    cameras = [key for key, dtype in dtypes.items() if dtype == "video"]
    if not cameras and "image" in dtypes.values():
        raise InputError(
            f"{folder}: its pictures are stored one by one; expected videos, "
            "record it with lerobot's use_videos=True"
        )
    if not cameras:
        raise InputError(
            f"{folder}: no camera, that is no feature of dtype 'video'; "
            f"there are: {', '.join(_short(list(features)))}"
        )
    if camera is None:
        if len(cameras) > 1:
            raise InputError(f"{folder}: has several cameras, choose one: {', '.join(cameras)}")
        return cameras[0]
    for key in (camera, IMAGES_PREFIX + camera):
        if key in cameras:
            return key
    raise UnknownName("camera", camera, str(folder), cameras)


def _read_episodes(folder: Path, info: dict[str, Any], camera: str) -> tuple[Episode, ...]:
    """All episodes, by index."""
    paths = sorted((folder / "meta" / "episodes").rglob("*.parquet"))
    if not paths:
        raise InputError(
            f"{folder}: meta/episodes/ holds no parquet file; expected "
            "meta/episodes/chunk-000/file-000.parquet, copy the dataset again"
        )
    data_path = _template(folder, info, "data_path", DATA_PATH)
    video_path = _template(folder, info, "video_path", VIDEO_PATH)
    video = f"videos/{camera}"
    columns = ["episode_index", "length", "data/chunk_index", "data/file_index"]
    columns += [f"{video}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
    episodes: dict[int, Episode] = {}
    for path in paths:
        for row in read_table(path, columns).to_pylist():
            empty = [column for column in columns if not _is_number(row[column])]
            if empty:
                raise InputError(
                    f"{path}: episode {row['episode_index']}: expected a number in "
                    f"{empty[0]!r}, got {row[empty[0]]!r}"
                )
            index, num_rows = int(row["episode_index"]), int(row["length"])
            if index in episodes:
                raise InputError(f"{path}: episode {index} is listed twice")
            if num_rows < 2:
                raise InputError(
                    f"{folder}: episode {index} has {num_rows} row{'s' * (num_rows != 1)}; "
                    "expected at least 2, a frame before and a frame after an action"
                )
            data_file = data_path.format(
                chunk_index=row["data/chunk_index"], file_index=row["data/file_index"]
            )
            video_file = video_path.format(
                video_key=camera,
                chunk_index=row[f"{video}/chunk_index"],
                file_index=row[f"{video}/file_index"],
            )
            episodes[index] = Episode(
                index=index,
                num_rows=num_rows,
                data_file=folder / data_file,
                video_file=folder / video_file,
                from_s=float(row[f"{video}/from_timestamp"]),
            )
    if not episodes:
        raise InputError(f"{folder}: holds no episode; expected at least one")
    total = info.get("total_episodes", len(episodes))
    if total != len(episodes):
        raise InputError(
            f"{folder}: expected {total} episodes as meta/info.json says, meta/episodes/ lists "
            f"{len(episodes)}; copy the dataset again"
        )
    return tuple(episodes[index] for index in sorted(episodes))


def _template(folder: Path, info: dict[str, Any], key: str, default: str) -> str:
    """A path template of info.json, tried out once."""
    template = info.get(key) or default
    try:
        template.format(chunk_index=0, file_index=0, video_key="")
    except (AttributeError, KeyError, IndexError, ValueError, TypeError):
        raise InputError(
            f"{folder / INFO_PATH}: expected a {key} like {default!r}, got {template!r}"
        ) from None
    return template


def _is_number(value: Any) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _as_list(value: object) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else []


def _short(names: list[str], most: int = 12) -> list[str]:
    """At most so many names, for a message that stays one line."""
    names = [name for name in names if not name.startswith("stats/")]
    return names if len(names) <= most else [*names[:most], "..."]
