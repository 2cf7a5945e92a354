"""Interface of the kinds of recordings; `dataset.py` has the code common to all."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np

from simtune.columns import cut
from simtune.errors import InputError


@dataclass(frozen=True)
class Reading:
    """One number measured with each frame."""

    key: str  # under which several numbers are stored, such as "observation.state"
    index: int  # among the numbers of this key
    name: str  # such as "elbow"; "": none

    @property
    def place(self) -> str:
        return f"{self.key}[{self.index}]"

    @property
    def full_name(self) -> str:
        return f"{self.key}.{self.name}" if self.name else self.place


class Lines(NamedTuple):
    """Line numbers of rows in a text file."""

    path: Path
    numbers: Sequence[int]  # (T,) from 1, counting the header and empty lines

    def place(self, row: int) -> str:
        return f"line {self.numbers[row]} of {self.path}"


@dataclass(frozen=True)
class Rows:
    """An episode's actions and readings, on the clock of its pictures."""

    actions: np.ndarray  # (T, A) float64, all recorded columns
    times_s: np.ndarray  # (T,) rising
    until_s: float  # end of the time for which both pictures and actions are known
    # (T, D) float64, NaN if missing; no rows if no readings were requested
    readings: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    lines: Lines | None = None  # None: not read from a text file
    unused_s: float = 0.0  # for which the pictures go on after the last action
    unfilmed: int = 0  # last rows for which a video has no frame
    is_empty: np.ndarray | None = None  # (T, A) bool, a table's empty cells; None: there are none
    is_begun: np.ndarray | None = None  # (T,) bool, rows whose action begins then; None: all

    def __len__(self) -> int:
        return len(self.actions)

    @property
    def begin_s(self) -> np.ndarray:
        """Rising times at which actions begin, the episode with the first of them."""
        return self.times_s if self.is_begun is None else self.times_s[self.is_begun]


class Source(Protocol):
    """Episodes as stored on disk. Errors name the episode."""

    kind: str  # in words
    path: Path
    fps: float  # rows per second
    camera: str | None  # None: opened without pictures
    action_names: tuple[str, ...]  # (A,)
    readings: Sequence[Reading]  # all available ones
    robot_type: str | None
    episodes: Sequence[str]  # names
    kept: Sequence[int]  # indices of those that are used; all must be like the first of these
    files: Sequence[Path]  # all files that the content depends on

    def codec(self, episode: int) -> str:
        """Codec of an episode's pictures, e.g. "h264"."""
        ...

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        """Actions and the given `readings` of an episode. Raises InputError if unsound."""
        ...

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        """For each of the rising times, the nearest picture: its time, and (H, W, 3) uint8.

        Raises InputError if no picture is near, or it is damaged.
        """
        ...


# Limits of sound recordings: larger numbers are damaged, and must not fill the memory
MOST_ROWS = 100_000  # of an episode: an hour at 30 Hz
MOST_ACTIONS = 1_000
_MOST_NAMES = 12  # in a message, so that it stays one line
LEAST_FPS, MOST_FPS = 0.01, 1_000
MOST_UNFILMED = 2  # last rows of an episode that recorders lose: they stop the camera first


def is_rate(fps: object) -> TypeGuard[int | float]:
    """Whether `fps` is a plausible number of rows per second."""
    if not isinstance(fps, int | float) or isinstance(fps, bool):
        return False
    return LEAST_FPS <= fps <= MOST_FPS


def first_wrong(wrong: np.ndarray) -> int | None:
    """Index of the first True in `wrong` (T,); None: there is none."""
    return int(wrong.argmax()) if wrong.any() else None


def nearest_rows(where: object, times_s: np.ndarray, hz: float, num_rows: int) -> np.ndarray:
    """(K,) rows nearest to (K,) rising times, of `num_rows` at `hz`.

    Raises InputError, which begins with `where`, if one would be after the last.
    """
    rows = np.rint(times_s * hz).astype(int)
    if rows.max(initial=0) >= num_rows:
        raise InputError(
            f"{where}: has {num_rows} pictures at {hz:g} Hz; expected one at {times_s[-1]:g} s, "
            "leave the episode out"
        )
    return rows


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts swing2 before swing10."""
    return [(int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", name)]


def short(names: Sequence[str]) -> str:
    """The names, or the first few; what is not printable is escaped."""
    return cut([name if name.isprintable() else repr(name) for name in names], _MOST_NAMES)
