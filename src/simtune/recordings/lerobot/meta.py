"""Reads and checks meta/ of a LeRobotDataset; no frame is decoded."""

import reprlib
from dataclasses import dataclass
from pathlib import Path

from simtune.errors import InputError
from simtune.recordings.lerobot.episodes import Episode, read_episodes
from simtune.recordings.lerobot.features import action_names, choose_pictures, readings
from simtune.recordings.lerobot.json_file import read_object
from simtune.recordings.lerobot.layout import INFO_PATH, layout_of, unexpected
from simtune.recordings.source import LEAST_FPS, MOST_FPS, Reading, is_rate


@dataclass(frozen=True, kw_only=True)
class DatasetMeta:
    """A dataset's description; see `read_meta`."""

    version: str  # of the format
    fps: float
    camera: str | None  # key of the chosen camera; its pictures may be videos or images
    action_names: tuple[str, ...]
    readings: tuple[Reading, ...]
    robot_type: str | None
    episodes: tuple[Episode, ...]  # by index


def read_meta(folder: Path, camera: str | None = None, *, pictures: bool = True) -> DatasetMeta:
    """Read and check meta/ of a LeRobotDataset v3.0, v2.1 or v2.0.

    `camera` is a feature's key, with or without "observation.images."; it may be None if there is
    only one. Without `pictures`, no camera is chosen.

    Raises:
        InputError: the folder is not a sound dataset, or has no such camera; the message says why
            and what to do.
    """
    info = read_object(folder / INFO_PATH)
    version = info.get("codebase_version")
    layout = layout_of(version)
    if layout is None:
        raise InputError(
            f"{folder / INFO_PATH}: expected codebase_version v3.0, v2.1 or v2.0, "
            f"got {reprlib.repr(version)}; convert the dataset with lerobot"
        )
    fps, features, robot_type = (info.get(key) for key in ("fps", "features", "robot_type"))
    if not is_rate(fps):
        raise unexpected(folder, f"fps as a number from {LEAST_FPS} to {MOST_FPS}", fps)
    if not isinstance(features, dict):
        raise unexpected(folder, "an object 'features'", features)
    names = action_names(folder, features)
    camera, has_videos = choose_pictures(folder, features, camera) if pictures else (None, False)
    return DatasetMeta(
        version=str(version),
        fps=float(fps),
        camera=camera,
        action_names=names,
        readings=readings(features),
        robot_type=robot_type if isinstance(robot_type, str) else None,
        episodes=read_episodes(folder, info, layout, camera if has_videos else None),
    )
