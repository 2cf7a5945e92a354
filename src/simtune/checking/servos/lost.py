"""Readings that are missing, and single ones where no joint can have been: lost packets."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.checking.doubt import Doubt, grouped
from simtune.checking.servos.fit import Episodes
from simtune.columns import episode_in_words

_MAX_MISSING_SHARE = 1 / 3  # of an episode's readings
# A sensor that is slower than the log: no gap is longer than so many usual ones
_MAX_GAP_RATIO, _MIN_READINGS = 3.0, 8
_UNUSUAL_SHARE = 0.01  # of readings at each end, at least one, that do not tell a joint's travel
_FLICKER_NOISES = 100.0  # of a reading's usual noise
_MAX_LOST_ROWS = 5  # in a row: steps shorter than rows repeat a lost one


def missing(
    labels: Sequence[str], values: np.ndarray, lengths: Sequence[int], names: Sequence[str] = ()
) -> list[str]:
    """On (E, T + 1, D) readings, in episodes of these numbers of steps, and with these names."""
    known = [np.isfinite(read[: n + 1]).T for read, n in zip(values, lengths, strict=True)]
    shares = np.array([[_missing(is_read) for is_read in rows] for rows in known])  # (E, D)
    found = []
    for label, of_episodes in zip(labels, shares.T, strict=True):
        if (most := of_episodes.max()) > _MAX_MISSING_SHARE:
            episode = episode_in_words(names, int(of_episodes.argmax()))
            says = f"{most:.0%} of the steps of {episode} lack {label}: was its log cut, or is it "
            found.append((-most, Doubt(says + "another column?", episode, label)))
    return grouped(doubt for _, doubt in sorted(found, key=lambda one: one[0]))


def _missing(is_read: np.ndarray) -> float:
    """The share of (T + 1,) rows without a reading; 0 if it comes less often, but regularly."""
    gaps = np.diff(np.flatnonzero(is_read), prepend=-1, append=len(is_read))
    is_slow = is_read.sum() >= _MIN_READINGS and gaps.max() <= _MAX_GAP_RATIO * np.median(gaps)
    return 0.0 if is_slow else float((~is_read).mean())


def without_lost_packets(
    label: str,
    unit: str,
    commands: Episodes,
    measured: Episodes,
    noise: float,
    names: Sequence[str] = (),
) -> tuple[list[np.ndarray], list[str]]:
    """A joint's (T + 1,) readings in each episode, NaN instead of lost packets; and a warning.

    Such a reading is far from where the joint is otherwise, farther than it and its (T,) commands
    travel, and both before and after it the joint is where it may be. `noise`: what is usual for
    such readings.
    """
    values = np.sort(np.concatenate(list(measured)))
    values = values[np.isfinite(values)]
    unusual = math.ceil(_UNUSUAL_SHARE * len(values))
    if len(values) <= 2 * unusual:
        return list(measured), []
    low, high = values[unusual], values[-1 - unusual]
    far = max(high - low, float(np.ptp(np.concatenate(list(commands)))), _FLICKER_NOISES * noise)
    lost = [_lost(read, low - far, high + far) for read in measured]
    if not (num := sum(map(np.sum, lost))):
        return list(measured), []
    away = [np.where(out, np.abs(read - low), 0) for out, read in zip(lost, measured, strict=True)]
    episode = int(np.argmax([distances.max() for distances in away]))
    step = int(away[episode].argmax())
    of_several = f" (one of {num} such readings)" if num > 1 else ""
    kept = [np.where(out, np.nan, read) for out, read in zip(lost, measured, strict=True)]
    return kept, [
        f"{label} reads {measured[episode][step]:.3g} {unit} at step {step} of "
        f"{episode_in_words(names, episode)} and {low:.3g} to {high:.3g} otherwise{of_several}: a "
        "lost packet? Leave such cells empty (NaN), as is done here"
    ]


def _lost(read: np.ndarray, low: float, high: float) -> np.ndarray:
    """(T + 1,) bool: readings outside of these bounds, a few in a row, and inside again."""
    known = np.flatnonzero(np.isfinite(read))
    is_out = (read[known] < low) | (read[known] > high)
    lost = np.zeros(len(read), bool)
    for start, end in np.flatnonzero(np.diff(np.pad(is_out, 1))).reshape(-1, 2):
        if start > 0 and end < len(known) and end - start <= _MAX_LOST_ROWS:
            lost[known[start:end]] = True
    return lost
