"""Sentences on time stamps that do not rise, or jump."""

import numpy as np

from simtune.recordings.source import Lines

_MAX_PAUSE_SHARE = 0.5  # of the time that an episode lasts: a longer gap is no pause


def not_rising(times_s: np.ndarray, row: int, lines: Lines, since: str = "") -> str:
    """What is wrong with a row's time, that is not after the one before; `since` says from when."""
    place, time_s = lines.place(row), float(times_s[row])
    before_s = float(times_s[row - 1]) if row else None
    if time_s == before_s:
        return (
            f"{place}: is of the same time as line {lines.numbers[row - 1]}, {time_s} s: "
            "merge such rows into one"
        )
    after = "" if before_s is None else f" after {before_s}"
    return f"{place}: expected rising seconds{since}, got {time_s}{after}" + (
        ": sort the rows by time" if before_s is not None and time_s < before_s else ""
    )


def jump(times_s: np.ndarray, lines: Lines | None) -> str:
    """Where (T,) rising times jump by most of what they last, or nothing."""
    if len(times_s) < 2:
        return ""
    gaps = np.diff(times_s)
    row = int(gaps.argmax())
    if gaps[row] < _MAX_PAUSE_SHARE * (times_s[-1] - times_s[0]):
        return ""
    first, then = (row, row + 1) if lines is None else lines.numbers[row : row + 2]
    what = "rows" if lines is None else "lines"
    return (
        f"they jump by {gaps[row]:.6g} s between {what} {first} and {then}: if what follows is "
        "another clock's, shift it"
    )
