"""Episodes of a LeRobotDataset: a row is a frame and the action applied after it for 1/fps s."""

import functools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from simtune.columns import counted
from simtune.errors import InputError
from simtune.recordings import video
from simtune.recordings.choosing import kept_episodes, leave_out_option, left_out
from simtune.recordings.lerobot.episodes import Episode
from simtune.recordings.lerobot.images import episode_pictures, first_picture
from simtune.recordings.lerobot.meta import read_meta
from simtune.recordings.lerobot.parquet import lists, numbers, read_table
from simtune.recordings.lerobot.unfilmed import NEAR, num_unfilmed, shown_s
from simtune.recordings.readings import gather
from simtune.recordings.source import MOST_UNFILMED, Reading, Rows, first_wrong
from simtune.recordings.still import kind_of


class LeRobotSource:
    """A folder in a LeRobotDataset's layout; see `read_meta`. Raises InputError."""

    def __init__(
        self,
        folder: Path,
        camera: str | None = None,
        *,
        pictures: bool = True,
        leave_out: Sequence[str] = (),
    ):
        meta = read_meta(folder, camera, pictures=pictures)
        self.kind = f"LeRobotDataset {meta.version}"
        self.path, self.fps, self.camera = folder, meta.fps, meta.camera
        self.action_names, self.robot_type = meta.action_names, meta.robot_type
        self.readings: Sequence[Reading] = meta.readings
        self.episodes: Sequence[str] = [f"episode {episode.index}" for episode in meta.episodes]
        self.kept = kept_episodes(folder, self.episodes, leave_out)
        self._episodes = meta.episodes
        tables = {path for part in ("meta", "data") for path in (folder / part).rglob("*.*")}
        videos = {e.video_file for e in meta.episodes if e.video_file}
        self.files: Sequence[Path] = [*tables, *videos]
        # The latest file is kept, since the next episode is usually in it.
        self._data = functools.lru_cache(maxsize=1)(_read_data)
        self._shown_s = functools.lru_cache(maxsize=1)(shown_s)

    def codec(self, episode: int) -> str:
        where = self._episodes[episode]
        if where.video_file:
            return video.codec_of(where.video_file)
        return kind_of(first_picture(where, self._key))

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        where = self._episodes[episode]
        if where.num_rows < 2:
            names = [*left_out(self), self.episodes[episode]]
            raise InputError(
                f"{self.path}: episode {where.index} has {counted(where.num_rows, 'row')}; "
                "expected at least 2, a frame before and a frame after an action; leave it out "
                f"({leave_out_option(names)})"
            )
        table = self._data(where.data_file, tuple({reading.key: None for reading in readings}))
        rows = table.filter(pc.field("episode_index") == where.index)
        if len(rows) != where.num_rows:
            raise InputError(
                f"{where.data_file}: expected {where.num_rows} rows of episode {where.index}, "
                f"got {len(rows)}; copy the dataset again"
            )
        rows = rows.sort_by("frame_index")
        self._check_order(rows, where)
        times_s = self._times(rows["timestamp"].to_numpy(), where)
        actions = self._lists(rows["action"], len(self.action_names), "actions", where)

        def read(key: str) -> np.ndarray:
            num = sum(reading.key == key for reading in self.readings)
            return self._lists(rows[key], num, f"numbers of {key!r}", where)

        found = gather(readings, len(rows), read)
        unfilmed = 0
        if where.video_file is not None:
            asked_s = where.from_s + times_s
            seen_s = self._shown_s(where.video_file)
            unfilmed = num_unfilmed(seen_s, asked_s, where.until_s, self.fps)
        until_s = float(times_s[-1 - unfilmed])
        return Rows(actions, times_s, until_s, found, unfilmed=unfilmed)

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        where = self._episodes[episode]
        if where.video_file is None:
            yield from episode_pictures(where, self._key, times_s, self.fps)
            return
        frames = video.frames_at(
            where.video_file, (where.from_s + times_s).tolist(), tolerance_s=NEAR / self.fps
        )
        for time_s, picture in frames:
            yield time_s - where.from_s, picture

    @property
    def _key(self) -> str:
        """Of the camera's pictures."""
        if self.camera is None:
            raise ValueError("it was opened without pictures")
        return self.camera

    def _check_order(self, rows: pa.Table, where: Episode) -> None:
        """Raise InputError unless rows are frames 0, 1, 2, ... of the episode that meta/ names."""
        frame_index = rows["frame_index"].to_numpy()
        if (row := first_wrong(frame_index != np.arange(len(rows)))) is not None:
            raise InputError(
                f"{self.path}: episode {where.index}: expected frame_index {row}, "
                f"got {frame_index[row]:g}; rows are missing or doubled"
            )
        if "index" not in rows.column_names or where.first_index is None:
            return
        if (first := rows["index"][0].as_py()) != where.first_index:
            raise InputError(
                f"{where.data_file}: episode {where.index}: expected index {where.first_index} "
                f"in its first row as meta/episodes says, got {first:g}; "
                "episodes are mixed up, copy the dataset again"
            )

    def _times(self, timestamp_s: np.ndarray, where: Episode) -> np.ndarray:
        """(T,) seconds since the episode's start in its video, exactly 1/fps apart.

        As in lerobot, they need not begin at 0: rows may have been cut off. Raises InputError
        unless timestamps are 1/fps apart and lie within the episode's part of the video, but for
        the few last that recorders may lose.
        """
        start_s = float(np.nan_to_num(timestamp_s[0]))
        times_s = start_s + np.arange(len(timestamp_s)) / self.fps
        is_late = ~(np.abs(timestamp_s - times_s) < 0.5 / self.fps)
        if (row := first_wrong(is_late)) is not None:
            raise InputError(
                f"{self.path}: episode {where.index}, row {row}: expected timestamp "
                f"{times_s[row]:g} s at {self.fps:g} frames/s, got {timestamp_s[row]:g} s; "
                "is fps in meta/info.json right?"
            )
        if where.from_s + times_s[-1] > where.until_s + (MOST_UNFILMED - 0.5) / self.fps:
            raise InputError(
                f"{self.path}: episode {where.index}: timestamps from {start_s:g} s to "
                f"{times_s[-1]:g} s; expected seconds since its first frame, of "
                f"{where.until_s - where.from_s:g} s of video; mend them in {where.data_file}"
            )
        return times_s

    def _lists(self, column: pa.ChunkedArray, num: int, what: str, where: Episode) -> np.ndarray:
        """(T, num) numbers; NaN if a number or a whole list is missing."""
        lengths, flat = lists(column)
        is_there = lengths >= 0
        if (row := first_wrong(is_there & (lengths != num))) is not None:
            raise InputError(
                f"{self.path}: episode {where.index}, row {row}: expected {num} {what} "
                f"as meta/info.json says, got {lengths[row]}"
            )
        values = np.full((len(lengths), num), np.nan)
        values[is_there] = flat.reshape(-1, num)
        return values


def _read_data(path: Path, keys: Sequence[str]) -> pa.Table:
    """Read a file of rows: actions and `keys` as stored, other columns as float64.

    Missing numbers are NaN.
    """
    stored = ("action", *keys)
    table = read_table(path, [*stored, "episode_index", "frame_index", "timestamp"], ["index"])
    columns = {
        name: numbers(table, name, path) for name in table.column_names if name not in stored
    }
    return pa.table({**{name: table[name] for name in stored}, **columns})
