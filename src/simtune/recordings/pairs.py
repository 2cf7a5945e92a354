"""A folder of pairs: NAME.mp4 or .mov, and NAME.csv with a row per control step.

Or of videos alone, of motion without actions. See docs/recordings.md.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from simtune.between_rows import typical_step_s
from simtune.errors import InputError
from simtune.recordings import video
from simtune.recordings.choosing import kept_episodes
from simtune.recordings.csv_table import MEASURED, is_reading, is_time, read_header, read_rows
from simtune.recordings.held import begins
from simtune.recordings.readings import gather, readings_of
from simtune.recordings.source import Lines, Reading, Rows, first_wrong, is_rate, natural, short
from simtune.recordings.time_stamps import not_rising

_OTHER_CLOCK_RATIO = 10  # to the video's end: milliseconds, or seconds since 1970
VIDEOS, TABLE = (".mp4", ".mov"), ".csv"  # case-insensitive


class PairsSource:
    """Pairs of a video and a table with the same name, one per episode, sorted by name.

    Without `pictures`, tables are enough if they have a column of times. Raises InputError if a
    file has no partner, or the tables' columns differ.
    """

    def __init__(
        self,
        folder: Path,
        camera: str | None = None,
        *,
        pictures: bool = True,
        leave_out: Sequence[str] = (),
    ):
        if pictures and camera is not None:
            raise InputError(
                f"{folder}: pairs of mp4 and csv have one camera, without a name; "
                "leave out --camera, or the camera's key in the tuning file; two cameras need a "
                "LeRobotDataset, or arrays with frames.NAME of each"
            )
        self.path, self.camera = folder, "mp4" if pictures else None
        self.robot_type: str | None = None
        seen = [p for p in sorted(folder.iterdir()) if not p.name.startswith(".")]
        self._videos = _by_name(path for path in seen if path.suffix.lower() in VIDEOS)
        self._tables = _by_name(path for path in seen if path.suffix.lower() == TABLE)
        self._check_partners()
        found = ["mp4"] * bool(self._videos) + ["csv"] * bool(self._tables)
        self.kind = f"folder of {' and '.join(found)}"
        self._is_acted_on = bool(self._tables)
        self.episodes: Sequence[str] = sorted(self._tables or self._videos, key=natural)
        self.kept = kept_episodes(folder, self.episodes, leave_out)
        self._header = read_header(self._table(self.kept[0])) if self._tables else []
        self._is_timed = any(map(is_time, self._header))
        measured = [name for name in self._header if is_reading(name)]
        self._actions = [
            column
            for column, name in enumerate(self._header)
            if not is_time(name) and not is_reading(name)
        ]
        self.action_names = tuple(self._header[column] for column in self._actions)
        names = [name[len(MEASURED) + 1 :] for name in measured]
        self.readings: Sequence[Reading] = readings_of(MEASURED, names, len(names))
        videos = self._videos.values() if pictures or not self._is_timed else ()
        self.files: Sequence[Path] = [*videos, *self._tables.values()]
        self.fps = self._fps()

    def codec(self, episode: int) -> str:
        return video.codec_of(self._video(episode))

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        if not self._is_acted_on:
            seen_s = self._frame_times(episode)
            return Rows(np.empty((len(seen_s), 0)), seen_s, float(seen_s[-1]))
        path = self._table(episode)
        header = read_header(path)
        if header != self._header:
            raise InputError(
                f"{path}: expected the columns of {self._table(self.kept[0]).name} "
                f"({short(self._header)}), got {short(header)}"
            )
        table, is_empty, lines = read_rows(path, len(header))
        measured = table[:, [is_reading(name) for name in header]]
        times_s, until_s, unused_s = self._times(episode, table, lines)
        found = gather(readings, len(table), lambda _: measured)
        return Rows(
            actions=table[:, self._actions],
            times_s=times_s,
            until_s=until_s,
            readings=found,
            lines=lines,
            unused_s=unused_s,
            is_empty=is_empty[:, self._actions],
        )

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        path = self._video(episode)
        # A webcam drops a frame now and then; the neighbouring frame is used instead.
        tolerance_s = 1.6 * typical_step_s(video.frame_times(path))
        return video.frames_at(path, times_s.tolist(), tolerance_s=tolerance_s)

    def _check_partners(self) -> None:
        """Raise InputError if only some videos have tables, or a table lacks a needed video."""
        videos, tables = self._videos.keys(), self._tables.keys()
        lone = videos - tables if self.camera is None else videos ^ tables
        if tables and lone:
            name = min(lone)
            missing = "csv" if name in videos else "mp4 or .mov"
            there = (self._videos | self._tables)[name].name
            raise InputError(
                f"{self.path}: {there} has no {name}.{missing} beside it; expected pairs "
                "of a video and its actions, see docs/recordings.md"
            )

    def _video(self, episode: int) -> Path:
        name = self.episodes[episode]
        if name not in self._videos:  # only possible without pictures
            raise InputError(
                f"{self._tables[name]}: says nowhere when its rows were, and no video does; "
                "expected a column 'time' of seconds"
            )
        return self._videos[name]

    def _table(self, episode: int) -> Path:
        return self._tables[self.episodes[episode]]

    def _frame_times(self, episode: int) -> np.ndarray:
        """(F,) seconds of a video's frames, F >= 2. Raises InputError."""
        path = self._video(episode)
        seen_s = video.frame_times(path)
        if len(seen_s) < 2:
            raise InputError(f"{path}: holds one frame; expected at least 2")
        return seen_s

    def _fps(self) -> float:
        """Actions per second of the first used episode."""
        rows = self.rows(first := self.kept[0])
        times_s = rows.times_s
        if rows.is_empty is not None:
            times_s = times_s[begins(times_s, ~rows.is_empty)]
        fps = float(f"{1 / typical_step_s(times_s):.6g}")  # clocks are not more precise than that
        if not is_rate(fps):
            where = self._table(first) if self._is_acted_on else self._video(first)
            raise InputError(f"{where}: its rows come {fps:g} times a second; in seconds?")
        return fps

    def _times(
        self, episode: int, table: np.ndarray, lines: Lines
    ) -> tuple[np.ndarray, float, float]:
        """(T,) start times of an episode's rows, its end, and how long the video goes on then.

        In seconds, since the first frame.
        """
        if self._is_timed:
            is_told = [is_time(name) for name in self._header]
            return self._told_times(episode, table[:, is_told], lines)
        seen_s = self._frame_times(episode)
        if len(seen_s) - len(table) not in (0, 1):
            raise InputError(
                f"{self._table(episode)}: {len(table)} rows, {self._video(episode).name} has "
                f"{len(seen_s)} frames; expected a row a frame (the last may be missing), or a "
                "column 'time'; is the video whole?"
            )
        return seen_s[: len(table)], float(seen_s[-1]), 0.0

    def _told_times(
        self, episode: int, column: np.ndarray, lines: Lines
    ) -> tuple[np.ndarray, float, float]:
        """Like `_times`, from the table's own column of times."""
        path, times_s = self._table(episode), column[:, 0]
        seen_s = None if self.camera is None else self._frame_times(episode)
        frame_s = 0.0 if seen_s is None else typical_step_s(seen_s)
        # Any zero will do where nothing is filmed; else a clock that rounds is off by half a frame
        first_s = -np.inf if seen_s is None else -frame_s / 2 - 1e-9
        if (row := first_wrong(~(np.diff(times_s, prepend=first_s) > 0))) is not None:
            since = "" if seen_s is None else " since the video's first frame"
            raise InputError(not_rising(times_s, row, lines, since))
        if seen_s is None:
            return times_s, float(times_s[-1]), 0.0
        step_s = typical_step_s(times_s)
        spare_s = max(step_s, frame_s)
        if times_s[-1] > seen_s[-1] + 1.02 * spare_s:
            is_other = times_s[-1] > _OTHER_CLOCK_RATIO * (seen_s[-1] + spare_s)
            asks = "are its times in seconds, and counted from there" if is_other else ""
            raise InputError(
                f"{path}: actions until {times_s[-1]:.10g} s, {self._video(episode).name} ends at "
                f"{seen_s[-1]:g} s; expected seconds since the video's first frame; "
                f"{asks or 'is the video whole'}?"
            )
        ends_s, until_s = float(seen_s[-1]), float(times_s[-1]) + step_s
        return times_s, min(ends_s, until_s), max(0.0, ends_s - until_s)


def _by_name(paths: Iterable[Path]) -> dict[str, Path]:
    """{name without ending: path}. Raises InputError if two have the same name."""
    found: dict[str, Path] = {}
    for path in paths:
        if path.stem in found:
            raise InputError(f"{path} and {found[path.stem].name} have one name; rename one")
        found[path.stem] = path
    return found
