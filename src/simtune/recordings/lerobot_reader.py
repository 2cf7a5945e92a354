"""Read a LeRobotDataset v3.0: frames and actions, nothing else.

A row of such a dataset is a frame and the action applied after it for 1/fps seconds. An
episode of T rows therefore gives a trajectory of T frames and T - 1 actions: what the last
action did was not filmed. Rewards, states and the like are left unread.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from simtune.errors import InputError
from simtune.recordings import video
from simtune.recordings.lerobot_meta import (
    DatasetMeta,
    Episode,
    dataset_hash,
    read_meta,
    read_table,
)
from simtune.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Episodes read from a dataset, and what is known of where they come from."""

    trajectories: list[Trajectory]  # by episode index
    meta: DatasetMeta
    image_size: tuple[int, int]  # (height, width) of the frames, pixels
    source_size: tuple[int, int]  # (height, width) in the video, pixels
    codec: str  # of the video, e.g. "h264"
    dataset_hash: str  # SHA-256 over meta/ and data/

    @property
    def fps(self) -> float:
        return self.meta.fps

    @property
    def step_s(self) -> float:
        return 1 / self.meta.fps

    @property
    def facts(self) -> dict[str, Any]:
        """What to note down of the recording; JSON."""
        return {
            "folder": str(self.meta.folder),
            "dataset_hash": self.dataset_hash,
            "robot_type": self.meta.robot_type,
            "camera": self.meta.camera,
            "codec": self.codec,
            "source_size": list(self.source_size),
            "image_size": list(self.image_size),
            "fps": self.meta.fps,
            "action_names": list(self.meta.action_names),
            "episodes": len(self.trajectories),
            "episodes_in_dataset": len(self.meta.episodes),
            "steps": sum(len(trajectory) for trajectory in self.trajectories),
        }


def read_dataset(
    folder: str | Path,
    *,
    camera: str | None = None,
    image_size: tuple[int, int] | int | None = None,
    num_actions: int | None = None,
    max_episodes: int | None = None,
) -> Recording:
    """Read the first `max_episodes` episodes (None: all) of a LeRobotDataset v3.0.

    Frames are resized to `image_size` by area averaging. One number is the side of a square: the
    middle of a landscape picture, whole in height, which is what a square MuJoCo camera of the
    same field of view (it is vertical) films. (height, width) keeps the whole picture and squeezes
    it where its aspect is another one. None keeps the source's size. `camera` and `num_actions`:
    see `read_meta`. Videos are decoded in one pass; full-size frames are held one at a time.

    Raises:
        InputError: the dataset is unsound; one line says what was expected and what to do.
    """
    meta = read_meta(folder, camera=camera, num_actions=num_actions)
    if max_episodes is not None and max_episodes < 1:
        raise InputError(f"max_episodes must be at least 1, got {max_episodes}")
    square = isinstance(image_size, int)
    if isinstance(image_size, int):
        image_size = (image_size, image_size)
    if image_size is not None and min(image_size) < 1:
        raise InputError(f"image_size must be at least 1 pixel, got {image_size}")
    episodes = meta.episodes[:max_episodes]
    actions = _read_actions(meta, episodes)  # before the frames: cheap, and finds most faults
    facts = video.probe(episodes[0].video_file)
    source_size = (facts.height, facts.width)
    if square and facts.height > facts.width:
        raise InputError(
            f"{episodes[0].video_file}: the picture is upright, {facts.width}×{facts.height}; "
            "expected one at least as wide as high; crop it to a square"
        )
    frames = _read_frames(meta, episodes, image_size or source_size, square)
    return Recording(
        trajectories=[
            Trajectory(frames[episode.index], actions[episode.index][:-1], 1 / meta.fps)
            for episode in episodes
        ],
        meta=meta,
        image_size=image_size or source_size,
        source_size=source_size,
        codec=facts.codec,
        dataset_hash=dataset_hash(folder),
    )


def _read_actions(meta: DatasetMeta, episodes: Sequence[Episode]) -> dict[int, np.ndarray]:
    """Actions (T, A) float32 of each episode's T rows, by episode index."""
    actions: dict[int, np.ndarray] = {}
    for path, group in _grouped(episodes, "data_file").items():
        table = read_table(path, ["action", "episode_index", "frame_index", "timestamp"])
        episode_index = _numbers(table, "episode_index", path)
        frame_index = _numbers(table, "frame_index", path)
        timestamp_s = _numbers(table, "timestamp", path)
        for episode in group:
            (rows,) = np.nonzero(episode_index == episode.index)
            if len(rows) != episode.num_rows:
                raise InputError(
                    f"{path}: expected {episode.num_rows} rows of episode {episode.index}, "
                    f"got {len(rows)}; copy the dataset again"
                )
            rows = rows[np.argsort(frame_index[rows], kind="stable")]
            _check_times(meta, episode, frame_index[rows], timestamp_s[rows])
            actions[episode.index] = _action_rows(meta, episode, table["action"].take(rows))
    return actions


def _check_times(
    meta: DatasetMeta, episode: Episode, frame_index: np.ndarray, timestamp_s: np.ndarray
) -> None:
    """Rows must be the frames 0, 1, 2, ... at 1/fps seconds from one to the next."""
    expected = np.arange(episode.num_rows)
    wrong = frame_index != expected
    if wrong.any():
        row = int(wrong.argmax())
        raise InputError(
            f"{meta.folder}: episode {episode.index}: expected frame_index {row}, "
            f"got {frame_index[row]:g}; rows are missing or doubled"
        )
    late = ~(np.abs(timestamp_s - timestamp_s[0] - expected / meta.fps) < 0.5 / meta.fps)
    if late.any():
        row = int(late.argmax())
        raise InputError(
            f"{meta.folder}: episode {episode.index}, row {row}: expected timestamp "
            f"{row / meta.fps:g} s at {meta.fps:g} frames/s, got {timestamp_s[row]:g} s; "
            "is fps in meta/info.json right?"
        )


def _action_rows(meta: DatasetMeta, episode: Episode, column: pa.ChunkedArray) -> np.ndarray:
    """(T, A) float32 out of lists of A numbers, or of plain numbers where A is 1."""
    where = f"{meta.folder}: episode {episode.index}"
    rows = column.to_pylist()
    actions = np.empty((len(rows), meta.num_actions), np.float64)
    for row, action in enumerate(rows):
        values = action if isinstance(action, list) else [action]
        if len(values) != meta.num_actions:
            raise InputError(
                f"{where}, row {row}: expected {meta.num_actions} actions as meta/info.json says, "
                f"got {len(values)}"
            )
        try:
            actions[row] = [np.nan if value is None else value for value in values]
        except (TypeError, ValueError):
            raise InputError(f"{where}, row {row}: action is not a number: {action!r}") from None
    finite = np.isfinite(actions).all(1)
    if not finite.all():
        row = int(finite.argmin())
        raise InputError(
            f"{where}, row {row}: action is not finite: {actions[row].tolist()}; "
            "drop or repair the episode"
        )
    return actions.astype(np.float32)


def _read_frames(
    meta: DatasetMeta, episodes: Sequence[Episode], size: tuple[int, int], square: bool
) -> dict[int, np.ndarray]:
    """Frames (T, *size, 3) uint8 of each episode's T rows, by episode index.

    `square`: of the middle of the picture, as wide as it is high.
    """
    frames = {
        episode.index: np.empty((episode.num_rows, *size, 3), np.uint8) for episode in episodes
    }
    for path, group in _grouped(episodes, "video_file").items():
        group = sorted(group, key=lambda episode: episode.from_s)
        for before, after in itertools.pairwise(group):
            if after.from_s < before.from_s + (before.num_rows - 0.5) / meta.fps:
                raise InputError(
                    f"{path}: episode {after.index} starts at {after.from_s:g} s, before episode "
                    f"{before.index} ends; the timestamps in meta/episodes are wrong"
                )
        times_s = [
            episode.from_s + row / meta.fps for episode in group for row in range(episode.num_rows)
        ]
        pictures = video.frames_at(path, times_s, tolerance_s=0.5 / meta.fps)
        for episode in group:
            for row in range(episode.num_rows):
                try:
                    picture = next(pictures)
                except InputError as error:
                    raise InputError(f"episode {episode.index}, row {row}: {error}") from None
                if picture is None:
                    raise InputError(
                        f"{path}: expected {episode.num_rows} frames of episode {episode.index}, "
                        f"got none for row {row} (at {episode.from_s + row / meta.fps:g} s); "
                        "the video is truncated, copy the file again"
                    )
                if square:
                    beside = (picture.shape[1] - picture.shape[0]) // 2
                    picture = picture[:, beside : beside + picture.shape[0]]
                frames[episode.index][row] = video.resize(picture, size)
    return frames


def _numbers(table: pa.Table, column: str, path: Path) -> np.ndarray:
    """A column of numbers, (rows,) float64; lists of one number are taken as the number."""
    try:
        values = table[column].to_numpy()
        if values.dtype == object:
            values = [np.ravel(value)[0] for value in values]
        return np.asarray(values, np.float64)
    except (pa.ArrowException, TypeError, ValueError, IndexError):
        raise InputError(f"{path}: expected numbers in column {column!r}") from None


def _grouped(episodes: Iterable[Episode], attribute: str) -> dict[Path, list[Episode]]:
    """Episodes by the file that holds them."""
    groups: dict[Path, list[Episode]] = defaultdict(list)
    for episode in episodes:
        groups[getattr(episode, attribute)].append(episode)
    return groups
