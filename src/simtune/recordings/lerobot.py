"""LeRobotDataset v3.0: many episodes share a parquet file of actions, and a video.

A row is a frame and the action applied after it for 1/fps seconds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from simtune.errors import InputError
from simtune.recordings import video
from simtune.recordings.lerobot_episodes import Episode
from simtune.recordings.lerobot_meta import read_meta
from simtune.recordings.lerobot_table import lists, numbers, read_table
from simtune.recordings.source import Rows


@dataclass(frozen=True, kw_only=True)
class _Table:
    """A parquet file's rows."""

    path: Path
    episode_index: np.ndarray  # (rows,), as are the next three
    frame_index: np.ndarray
    timestamp_s: np.ndarray
    index: np.ndarray | None
    action: pa.ChunkedArray


class LeRobotSource:
    """A folder of the LeRobotDataset v3.0 layout. See `read_meta`; raises InputError."""

    kind = "LeRobotDataset v3.0"

    def __init__(self, folder: Path, camera: str | None = None):
        meta = read_meta(folder, camera)
        self.path, self.fps, self.camera = folder, meta.fps, meta.camera
        self.action_names, self.robot_type = meta.action_names, meta.robot_type
        self.episodes: Sequence[str] = [f"episode {episode.index}" for episode in meta.episodes]
        self._episodes = meta.episodes
        tables = {path for part in ("meta", "data") for path in (folder / part).rglob("*.*")}
        self.files: Sequence[Path] = [*tables, *{e.video_file for e in meta.episodes}]
        self._latest: _Table | None = None

    @property
    def codec(self) -> str:
        return video.probe(self._episodes[0].video_file).codec

    def rows(self, episode: int) -> Rows:
        where = self._episodes[episode]
        table = self._table(where.data_file)
        (rows,) = np.nonzero(table.episode_index == where.index)
        if len(rows) != where.num_rows:
            raise InputError(
                f"{table.path}: expected {where.num_rows} rows of episode {where.index}, "
                f"got {len(rows)}; copy the dataset again"
            )
        rows = rows[np.argsort(table.frame_index[rows], kind="stable")]
        self._check_order(table, where, rows)
        self._check_times(where, table.timestamp_s[rows])
        actions = self._actions(where, table.action.take(pa.array(rows)))
        return Rows(actions, np.arange(len(rows)) / self.fps, (len(rows) - 1) / self.fps)

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        where = self._episodes[episode]
        # Half a frame, and a little: between two frames either will do.
        frames = video.frames_at(
            where.video_file, (where.from_s + times_s).tolist(), tolerance_s=0.51 / self.fps
        )
        for shown_s, picture in frames:
            yield shown_s - where.from_s, picture

    def _table(self, path: Path) -> _Table:
        """A data file; the latest is kept, since the next episode lies in it as a rule."""
        if self._latest is None or self._latest.path != path:
            columns = ["action", "episode_index", "frame_index", "timestamp"]
            table = read_table(path, columns, optional=["index"])
            has_index = "index" in table.column_names
            self._latest = _Table(
                path=path,
                episode_index=numbers(table, "episode_index", path),
                frame_index=numbers(table, "frame_index", path),
                timestamp_s=numbers(table, "timestamp", path),
                index=numbers(table, "index", path) if has_index else None,
                action=table["action"],
            )
        return self._latest

    def _check_order(self, table: _Table, where: Episode, rows: np.ndarray) -> None:
        """Rows must be the frames 0, 1, 2, ..., and those that meta/ calls this episode."""
        frame_index = table.frame_index[rows]
        wrong = frame_index != np.arange(len(rows))
        if wrong.any():
            row = int(wrong.argmax())
            raise InputError(
                f"{self.path}: episode {where.index}: expected frame_index {row}, "
                f"got {frame_index[row]:g}; rows are missing or doubled"
            )
        if table.index is None or where.first_index is None:
            return
        if table.index[rows[0]] != where.first_index:
            raise InputError(
                f"{table.path}: episode {where.index}: expected index {where.first_index} in its "
                f"first row as meta/episodes says, got {table.index[rows[0]]:g}; "
                "episodes are mixed up, copy the dataset again"
            )

    def _check_times(self, where: Episode, timestamp_s: np.ndarray) -> None:
        """Rows must be 1/fps seconds from one to the next."""
        expected_s = np.arange(len(timestamp_s)) / self.fps
        late = ~(np.abs(timestamp_s - timestamp_s[0] - expected_s) < 0.5 / self.fps)
        if late.any():
            row = int(late.argmax())
            raise InputError(
                f"{self.path}: episode {where.index}, row {row}: expected timestamp "
                f"{expected_s[row]:g} s at {self.fps:g} frames/s, got {timestamp_s[row]:g} s; "
                "is fps in meta/info.json right?"
            )

    def _actions(self, where: Episode, column: pa.ChunkedArray) -> np.ndarray:
        """(T, A)."""
        lengths, flat = lists(column)
        wrong = lengths != len(self.action_names)
        if wrong.any():
            row = int(wrong.argmax())
            raise InputError(
                f"{self.path}: episode {where.index}, row {row}: expected "
                f"{len(self.action_names)} actions as meta/info.json says, got {lengths[row]}"
            )
        return flat.reshape(len(lengths), -1)
