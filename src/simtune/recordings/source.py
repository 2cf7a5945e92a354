"""What each kind of recordings has to tell; what all of them share is in `dataset.py`."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np

from simtune.errors import InputError


@dataclass(frozen=True)
class Reading:
    """One number of those that were measured beside each frame."""

    key: str  # of what is stored together, such as "observation.state"
    index: int  # among the numbers there
    name: str  # of its own, such as "elbow"; "": it has none

    @property
    def place(self) -> str:
        return f"{self.key}[{self.index}]"

    @property
    def full_name(self) -> str:
        return f"{self.key}.{self.name}" if self.name else self.place


class Lines(NamedTuple):
    """Where rows stand in a text file."""

    path: Path
    numbers: Sequence[int]  # (T,) from 1, the header and empty lines counted

    def place(self, row: int) -> str:
        return f"line {self.numbers[row]} of {self.path}"


@dataclass(frozen=True)
class Rows:
    """The actions of an episode and its readings, on the clock of its pictures."""

    actions: np.ndarray  # (T, A) float64, all that were recorded
    times_s: np.ndarray  # (T,) when each began to be applied, rising
    until_s: float  # up to when both pictures and actions are known
    # (T, D) float64, NaN where there is none; of no row where none were asked for
    readings: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    lines: Lines | None = None  # None: no text file

    def __len__(self) -> int:
        return len(self.actions)


class Source(Protocol):
    """Episodes as they lie on disk. Errors of an episode name it."""

    kind: str  # in words
    path: Path
    fps: float  # rows a second
    camera: str | None  # None: opened without pictures
    action_names: tuple[str, ...]  # (A,)
    readings: Sequence[Reading]  # all that can be asked for
    robot_type: str | None
    episodes: Sequence[str]  # what each is called
    files: Sequence[Path]  # all that its content depends on

    @property
    def codec(self) -> str:
        """Of the pictures, e.g. "h264"."""
        ...

    def rows(self, episode: int, readings: Sequence[Reading] = ()) -> Rows:
        """Raises InputError where they are unsound. No other readings are read."""
        ...

    def pictures(self, episode: int, times_s: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
        """For each of the rising times, when the nearest picture was seen, and (H, W, 3) uint8.

        Raises InputError where there is none near, or it is damaged.
        """
        ...


# No recording is longer in one piece: more is a damaged number, and must not fill the memory.
MOST_ROWS = 100_000  # of an episode: an hour at 30 Hz
MOST_ACTIONS = 1_000
LEAST_FPS, MOST_FPS = 0.01, 1_000


def is_rate(fps: object) -> TypeGuard[int | float]:
    """Whether it can be meant as rows a second."""
    if not isinstance(fps, int | float) or isinstance(fps, bool):
        return False
    return LEAST_FPS <= fps <= MOST_FPS


def first_wrong(wrong: np.ndarray) -> int | None:
    """The first of (T,) rows, some of which may be `wrong`; None: none is."""
    return int(wrong.argmax()) if wrong.any() else None


def natural(name: str) -> list[tuple[int, str]]:
    """Sorts swing2 before swing10."""
    return [(int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", name)]


def short(names: Sequence[str], most: int = 12) -> str:
    """At most `most` of the names, for a message that stays one line."""
    names = names if len(names) <= most else [*names[:most], "..."]
    return ", ".join(name if name.isprintable() else repr(name) for name in names)


def choose_camera(where: Path, cameras: Sequence[str], asked: str | None, full_name: str) -> str:
    """The asked one of `cameras`, as "front" or by its `full_name` of it, such as "{}_image".

    The only one, if none was asked for. Raises InputError where there is no such one.
    """
    keys = cameras if asked is None else (asked, full_name.format(asked))
    if asked is None and len(cameras) > 1:
        raise InputError(f"{where}: has several cameras, choose one by --camera: {short(cameras)}")
    for key in keys:
        if key in cameras:
            return key
    raise InputError(f"{where}: no camera {asked!r}; there are: {short(cameras)}")


def choose_actions(
    source: Source, names: Sequence[str] | None, num_actions: int | None
) -> list[int]:
    """Columns of the actions called `names` (None: all), which must be `num_actions` if given.

    Raises InputError where there are no such ones.
    """
    known = source.action_names
    doubled = next((name for name in known if known.count(name) > 1), None)
    for name in names or ():
        if name not in known or name == doubled:
            what = "more than one" if name == doubled else "no"
            raise InputError(f"{source.path}: {what} action {name!r}; there are: {short(known)}")
    chosen = [known.index(name) for name in names] if names else list(range(len(known)))
    if num_actions is not None and len(chosen) != num_actions:
        hint = (
            "is it of another robot?" if known else "a CSV beside each video has a column of each"
        )
        if names or len(known) > num_actions:
            hint = (
                "name the task's, in its order, by --actions NAME,NAME,...; in a CSV, columns that "
                "were measured are called measured.NAME"
            )
        there = f"{len(known)} ({short(known)})" if known else "none"
        has = f"--actions names {len(chosen)} of {there}" if names else f"the recording has {there}"
        raise InputError(f"{source.path}: the task takes {num_actions} actions, {has}; {hint}")
    return chosen
