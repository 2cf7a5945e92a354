"""What a LeRobotDataset v3.0 says of itself: meta/ read and checked, no frame decoded."""

import json
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.recordings.lerobot.episodes import Episode, read_episodes
from simtune.recordings.lerobot.layout import IMAGES_PREFIX, INFO_PATH, unexpected
from simtune.recordings.source import (
    LEAST_FPS,
    MOST_ACTIONS,
    MOST_FPS,
    choose_camera,
    is_rate,
    short,
)

_MOST_BYTES = 100_000_000  # of a JSON file, which is read whole


@dataclass(frozen=True, kw_only=True)
class DatasetMeta:
    """A dataset's description, as read by `read_meta`."""

    fps: float
    camera: str  # key of the chosen camera
    action_names: tuple[str, ...]
    robot_type: str | None
    episodes: tuple[Episode, ...]  # by index


def read_meta(folder: Path, camera: str | None = None) -> DatasetMeta:
    """Read and check meta/ of a LeRobotDataset v3.0.

    `camera` is a video key, "observation.images." left off if you like; it may be None where
    there is only one.

    Raises:
        InputError: the folder is no sound v3.0 dataset, or has no such camera; the message says
            why and what to do.
    """
    info = _read_info(folder / INFO_PATH)
    fps, features, robot_type = (info.get(key) for key in ("fps", "features", "robot_type"))
    if not is_rate(fps):
        raise unexpected(folder, f"fps as a number from {LEAST_FPS} to {MOST_FPS}", fps)
    if not isinstance(features, dict):
        raise unexpected(folder, "an object 'features'", features)
    action_names = _action_names(folder, features)
    camera = _choose_camera(folder, features, camera)
    return DatasetMeta(
        fps=float(fps),
        camera=camera,
        action_names=action_names,
        robot_type=robot_type if isinstance(robot_type, str) else None,
        episodes=read_episodes(folder, info, camera),
    )


def _read_info(path: Path) -> dict[str, Any]:
    """meta/info.json of a v3 dataset."""
    size = path.stat().st_size
    if size > _MOST_BYTES:
        raise InputError(f"{path}: expected a few kB, got {size / 1e6:.0f} MB")
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(info, dict):
        raise InputError(f"{path}: expected a JSON object, got {type(info).__name__}")
    version = info.get("codebase_version")
    if not isinstance(version, str) or not (version == "v3" or version.startswith("v3.")):
        raise InputError(
            f"{path}: expected codebase_version v3.0, got {reprlib.repr(version)}; "
            "convert the dataset with lerobot's convert_dataset_v21_to_v30"
        )
    return info


def _action_names(folder: Path, features: dict[str, Any]) -> tuple[str, ...]:
    """What each number of an action is called."""
    if "action" not in features:
        raise InputError(
            f"{folder}: no column 'action', and without actions nothing can be replayed; "
            f"there are: {short(list(features))}"
        )
    feature = features["action"] if isinstance(features["action"], dict) else {}
    shape = _as_list(feature.get("shape"))
    if len(shape) != 1 or type(shape[0]) is not int or not 0 < shape[0] <= MOST_ACTIONS:
        expected = f"a shape [A] of 'action' with A from 1 to {MOST_ACTIONS}"
        raise unexpected(folder, expected, feature.get("shape"))
    names = feature.get("names")
    if isinstance(names, dict):  # {"motors": [...]}, as older recordings have it
        names = [name for group in names.values() for name in _as_list(group)]
    names = tuple(str(name) for name in _as_list(names))
    return names if len(names) == shape[0] else tuple(f"action_{i}" for i in range(shape[0]))


def _choose_camera(folder: Path, features: dict[str, Any], camera: str | None) -> str:
    """The chosen camera's key."""
    dtypes = {key: f.get("dtype") for key, f in features.items() if isinstance(f, dict)}
    cameras = [key for key, dtype in dtypes.items() if dtype == "video"]
    if not cameras and "image" in dtypes.values():
        raise InputError(
            f"{folder}: its pictures are stored one by one; expected videos, "
            "record it with lerobot's use_videos=True"
        )
    if not cameras:
        raise InputError(
            f"{folder}: no camera, that is no feature of dtype 'video'; "
            f"there are: {short(list(features))}"
        )
    return choose_camera(folder, cameras, camera, IMAGES_PREFIX + "{}")


def _as_list(value: object) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else []
