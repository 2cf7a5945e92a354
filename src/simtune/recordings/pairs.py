"""A folder of pairs: NAME.mp4 or .mov, and NAME.csv with a row a control step (docs/recordings.md).

Or of videos alone, of what moves without any action.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings import video
from simtune.recordings.csv_table import is_time, read_header, read_rows
from simtune.recordings.resample import typical_step_s
from simtune.recordings.source import Rows, first_wrong, is_rate, short

VIDEOS, TABLE = (".mp4", ".mov"), ".csv"  # in any case of letters


class PairsSource:
    """Videos and tables of the same names, an episode each, in the names' order.

    Raises InputError where a file has no partner, or the tables' columns differ.
    """

    kind = "folder of mp4 and csv"

    def __init__(self, folder: Path, camera: str | None = None):
        if camera is not None:
            raise InputError(f"{folder}: pairs of mp4 and csv have one camera; leave out --camera")
        self.path, self.camera = folder, "mp4"
        self.robot_type: str | None = None
        seen = [p for p in sorted(folder.iterdir()) if not p.name.startswith(".")]
        self._videos = _by_name(path for path in seen if path.suffix.lower() in VIDEOS)
        self._tables = _by_name(path for path in seen if path.suffix.lower() == TABLE)
        videos, tables = self._videos.keys(), self._tables.keys()
        if tables and (lone := sorted(videos ^ tables)):
            name, missing = lone[0], "csv" if lone[0] in videos else "mp4 or .mov"
            there = (self._videos | self._tables)[name].name
            raise InputError(
                f"{folder}: {there} has no {name}.{missing} beside it; expected pairs "
                "of a video and its actions, see docs/recordings.md"
            )
        self.episodes: Sequence[str] = sorted(videos, key=_natural)
        self.files: Sequence[Path] = [*self._videos.values(), *self._tables.values()]
        self._is_acted_on = bool(tables)
        self._header = read_header(self._table(0)) if tables else []
        self.action_names = tuple(name for name in self._header if not is_time(name))
        self.fps = self._fps()

    @property
    def codec(self) -> str:
        return video.probe(self._video(0)).codec

    def rows(self, episode: int) -> Rows:
        if not self._is_acted_on:
            seen_s = video.frame_times(self._video(episode))
            return Rows(np.empty((len(seen_s), 0)), seen_s, float(seen_s[-1]))
        path = self._table(episode)
        header = read_header(path)
        if header != self._header:
            raise InputError(
                f"{path}: expected the columns of {self._table(0).name} ({short(self._header)}), "
                f"got {short(header)}"
            )
        table = read_rows(path, len(header))
        seen_s = video.frame_times(self._video(episode))
        timed = [is_time(name) for name in header]
        actions = table[:, ~np.array(timed)]
        if any(timed):
            return self._timed(episode, table[:, timed.index(True)], actions, seen_s)
        if len(seen_s) - len(actions) not in (0, 1):
            raise InputError(
                f"{path}: {len(actions)} rows, {self._video(episode).name} has {len(seen_s)} "
                "frames; expected a row a frame (the last may be missing), or a column 'time'; "
                "is the video whole?"
            )
        return Rows(actions, seen_s[: len(actions)], float(seen_s[-1]))

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        path = self._video(episode)
        # A webcam drops a frame now and then; its neighbour stands in for it.
        tolerance_s = 1.6 * typical_step_s(video.frame_times(path))
        return video.frames_at(path, times_s.tolist(), tolerance_s=tolerance_s)

    def _video(self, episode: int) -> Path:
        return self._videos[self.episodes[episode]]

    def _table(self, episode: int) -> Path:
        return self._tables[self.episodes[episode]]

    def _fps(self) -> float:
        """Rows a second, of the first episode."""
        times_s = self.rows(0).times_s
        fps = float(f"{1 / typical_step_s(times_s):.6g}")  # clocks are no more exact than that
        if not is_rate(fps):
            where = self._table(0) if self._is_acted_on else self._video(0)
            raise InputError(f"{where}: its rows come {fps:g} times a second; in seconds?")
        return fps

    def _timed(
        self, episode: int, times_s: np.ndarray, actions: np.ndarray, seen_s: np.ndarray
    ) -> Rows:
        """Rows that say themselves when they began."""
        path = self._table(episode)
        if (row := first_wrong(~(np.diff(times_s, prepend=-1e-9) > 0))) is not None:
            raise InputError(
                f"{path}: row {row}: expected rising seconds since the video's first frame, "
                f"got {times_s[row]:g}"
            )
        step_s = typical_step_s(times_s)
        spare_s = max(step_s, typical_step_s(seen_s)) if len(seen_s) > 1 else step_s
        if times_s[-1] > seen_s[-1] + 1.02 * spare_s:
            raise InputError(
                f"{path}: actions until {times_s[-1]:g} s, {self._video(episode).name} ends at "
                f"{seen_s[-1]:g} s; expected seconds since the video's first frame"
            )
        return Rows(actions, times_s, min(float(seen_s[-1]), float(times_s[-1]) + step_s))


def _by_name(paths: Iterable[Path]) -> dict[str, Path]:
    """{name: path} without endings. Raises InputError for two of one name."""
    found: dict[str, Path] = {}
    for path in paths:
        if path.stem in found:
            raise InputError(f"{path} and {found[path.stem].name} have one name; rename one")
        found[path.stem] = path
    return found


def _natural(name: str) -> list[tuple[int, str]]:
    """Sorts swing2 before swing10."""
    return [(int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", name)]
