"""Interface of the kinds of recordings; `dataset.py` has the code common to all."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np

from simtune.columns import cut
from simtune.errors import InputError, UnknownName
from simtune.recordings import controllers


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


def kept_episodes(where: Path, episodes: Sequence[str], leave_out: Sequence[str]) -> Sequence[int]:
    """Indices of the episodes that are not left out; `3` is short for `episode 3`.

    Raises InputError if there is no such episode, or none is left.
    """
    names = [name.removeprefix("episode ") for name in episodes]
    asked = [name.removeprefix("episode ") for name in leave_out]
    for name in asked:
        if name not in names:
            raise UnknownName("episode", name, f"{where}, as --leave-out has it", names)
    kept = [index for index, name in enumerate(names) if name not in asked]
    if not kept:
        raise InputError(f"{where}: no episode remains of {len(names)}: leave out fewer")
    return kept


def left_out(source: Source) -> list[str]:
    """Names of the episodes that are not used."""
    kept = set(source.kept)
    return [name for index, name in enumerate(source.episodes) if index not in kept]


def leave_out_option(names: Sequence[str]) -> str:
    """The option to type; it replaces an earlier one, so names are all episodes to leave out."""
    return f"--leave-out {','.join(name.removeprefix('episode ') for name in names)}"


def choose_camera(where: Path, cameras: Sequence[str], asked: str | None, full_name: str) -> str:
    """The camera `asked` for, such as "front"; its key may be longer, such as "{}_image".

    `full_name`: template of the longer key. Without `asked`, the only camera. Raises InputError if
    there is no such camera.
    """
    keys = cameras if asked is None else (asked, full_name.format(asked))
    if asked is None and len(cameras) > 1:
        raise InputError(
            f"{where}: has several cameras, choose one by --camera, or name them by "
            f"key in the tuning file's [[cameras]]: {short(cameras)}"
        )
    for key in keys:
        if key in cameras:
            return key
    raise InputError(f"{where}: no camera {asked!r}; there are: {short(cameras)}")


def choose_actions(
    source: Source, names: Sequence[str] | None, num_actions: int | None
) -> list[int]:
    """Columns of the actions `names` (None: all). Raises InputError if one does not exist.

    Also if one is not the only one of its name, or there are not `num_actions`, if given.
    """
    known = source.action_names
    names = names or ()
    for i, name in enumerate(names):
        if name not in known:
            raise UnknownName("action", name, str(source.path), known)
        if known.count(name) > 1:
            raise InputError(
                f"{source.path}: more than one action {name!r}; there are: {short(known)}"
            )
        if name in names[:i]:
            raise InputError(f"{source.path}: action {name!r} is asked for twice; name it once")
    chosen = [known.index(name) for name in names] if names else list(range(len(known)))
    if num_actions is not None and len(chosen) != num_actions:
        hint = _hint(source, num_actions, is_chosen=bool(names))
        there = f"{len(known)} ({short(known)})" if known else "none"
        has = f"--actions names {len(chosen)} of {there}" if names else f"the recording has {there}"
        raise InputError(f"{source.path}: the task takes {num_actions} actions, {has}; {hint}")
    return chosen


def _hint(source: Source, num_actions: int, *, is_chosen: bool) -> str:
    """What to do where a recording has another number of actions than the task."""
    if not source.action_names:
        return "a CSV beside each video has a column of each"
    if not is_chosen and (controller := controllers.named_in(source.path)):
        return controller
    if is_chosen or len(source.action_names) > num_actions:
        return (
            "name the task's, in its order, by --actions NAME,NAME,...; in a CSV, columns that "
            "were measured are called measured.NAME"
        )
    return "is it of another robot?"
