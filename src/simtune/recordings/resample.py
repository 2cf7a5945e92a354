"""Resamples rows at recorded times to steps of equal duration."""

import math

import numpy as np

from simtune.between_rows import BRIDGED, read_nearest, typical_step_s
from simtune.recordings.source import Rows

_ON_TIME_SHARE = 0.02  # of a step, or a row: rows this near to a step's start are not resampled
_ROUNDED_CLOCK_SHARE = 0.25  # of a step: the same, of rows at the steps' own rate
_MIN_ROWS = 20  # fewer do not show whether a log is regular
_MIN_IN_TIME_SHARE = 0.9  # of a regular log's other rows: within half a step of their time
_MAX_REST_SHARE = 0.01  # of gaps: more are of a log of a command that rests now and then
_TURN_TOLERANCE = 1e-3  # of a turn, by which readings that were rounded may exceed it
_LOST_SHARE = 0.005  # of readings, such as lost packets, that may lie anywhere


def find_gaps(times_s: np.ndarray) -> list[tuple[float, float]]:
    """(start, end), in seconds, of gaps of more than two rows in an otherwise regular log.

    `times_s`: (T,) rising. A log of changes alone has none: it is irregular, or rests often.
    """
    if not is_regular(times_s):
        return []
    gaps = np.flatnonzero(_lasts(times_s) > BRIDGED)
    return [(float(times_s[row]), float(times_s[row + 1])) for row in gaps]


def is_regular(times_s: np.ndarray) -> bool:
    """Whether (T,) rising times come at one rate, but for a few gaps; false if there are few."""
    if len(times_s) < _MIN_ROWS:
        return False
    lasts = _lasts(times_s)
    is_gap = lasts > BRIDGED
    is_in_time = np.mean(np.abs(lasts[~is_gap] - 1) < 0.5) >= _MIN_IN_TIME_SHARE
    return bool(is_in_time and is_gap.sum() <= max(1, _MAX_REST_SHARE * len(lasts)))


def _lasts(times_s: np.ndarray) -> np.ndarray:
    return np.diff(times_s) / typical_step_s(times_s)


def step_times(rows: Rows, step_s: float) -> np.ndarray:
    """(K + 1,) seconds: starts of the K whole steps that fit into an episode, and the end."""
    begin_s = rows.begin_s
    lasts_s = rows.until_s - begin_s[0]
    row_s = typical_step_s(begin_s) if len(begin_s) > 1 else step_s
    # Of the shorter of both: a share of a long step would reach into what follows the episode.
    spare_s = _ON_TIME_SHARE * min(row_s, step_s)
    return begin_s[0] + step_s * np.arange(int((lasts_s + spare_s) / step_s) + 1)


def _is_same(row_s: float, step_s: float) -> bool:
    """Whether steps are at the rows' own rate."""
    return abs(row_s / step_s - 1) < 1e-3


def step_actions(rows: Rows, times_s: np.ndarray) -> np.ndarray:
    """(K, A) mean action over each step, for (K + 1,) times.

    A recorded action lasts until the next one begins. So shorter steps repeat actions, and longer
    steps average them, which preserves the impulse of a force and the path of a velocity.
    """
    num_steps, step_s = len(times_s) - 1, times_s[1] - times_s[0]
    begin_s = rows.begin_s
    num = min(len(begin_s), num_steps)  # the last may be held for longer
    late_s = np.abs(begin_s[:num] - times_s[:num])
    is_own_rate = len(begin_s) > 1 and _is_same(typical_step_s(begin_s), step_s)
    if late_s.max() <= (_ROUNDED_CLOCK_SHARE if is_own_rate else _ON_TIME_SHARE) * step_s:
        begun = rows.actions if rows.is_begun is None else rows.actions[rows.is_begun]
        return np.pad(begun[:num], ((0, num_steps - num), (0, 0)), mode="edge")
    if not rows.actions.shape[1]:
        return np.empty((num_steps, 0))
    until_s = max(rows.until_s, times_s[-1])
    known = rows.times_s < until_s
    edges_s = np.append(rows.times_s[known], until_s)
    summed = np.cumsum(rows.actions[known] * np.diff(edges_s)[:, None], 0)
    summed = np.concatenate([np.zeros_like(summed[:1]), summed])
    at_times = [np.interp(times_s, edges_s, column) for column in summed.T]
    return (np.diff(at_times) / step_s).T


def counted_on(readings: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """(T, D) readings without the jumps of encoders that begin again after their (D,) period.

    Only in columns that lie within their period: others count on already, and a jump is a fast
    wheel. A few outliers, such as lost packets, stay as they are. Periods are in the readings'
    units, infinite where nothing begins again. NaN: no reading.
    """
    counted = readings.copy()
    for column in np.flatnonzero(np.isfinite(periods)):
        known = np.flatnonzero(np.isfinite(readings[:, column]))
        values, period = readings[known, column], float(periods[column])
        inside = _within(values, (1 + _TURN_TOLERANCE) * period)
        turned = known[inside]
        counted[turned, column] = np.unwrap(values[inside], period=period)
    return counted


def _within(values: np.ndarray, width: float) -> np.ndarray:
    """(T,) bool: which values lie in the interval of a width that holds most of them.

    None if that leaves out more than a few.
    """
    if not len(values):
        return np.ones(0, bool)
    ordered = np.sort(values)
    held = np.searchsorted(ordered, ordered + width, "right") - np.arange(len(values))
    low, num_held = ordered[held.argmax()], held.max()
    may_lose = math.ceil(_LOST_SHARE * len(values)) if len(values) >= _MIN_ROWS else 0
    inside = (low <= values) & (values <= low + width)
    return inside & (len(values) - num_held <= may_lose)


def step_readings(rows: Rows, times_s: np.ndarray) -> np.ndarray:
    """(K + 1, D) readings at (K + 1,) times of even steps, each from the measurement nearest to it.

    NaN at steps that are nearest to no measurement, and where more than two in succession are
    missing; see `read_nearest`.
    """
    step_s = times_s[1] - times_s[0]
    rounding_s = _ON_TIME_SHARE * min(typical_step_s(rows.times_s), step_s)
    found = np.empty((len(times_s), rows.readings.shape[1]))
    for number, column in enumerate(rows.readings.T):
        found[:, number] = read_nearest(times_s, rows.times_s, column, rounding_s)
    return found
