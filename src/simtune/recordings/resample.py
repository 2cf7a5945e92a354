"""Resamples rows at recorded times to steps of equal duration."""

import math

import numpy as np

from simtune.between_rows import BRIDGED, gaps_at, own_step_s, read_between, typical_step_s
from simtune.recordings.source import Rows

_ON_TIME = 0.02  # of a step, or a row: rows this near to a step's start are not resampled
_ROUNDED = 0.25  # of a step: the same, of rows at the steps' own rate, whose clock rounds
_NEAR = 1.5  # steps between readings: on a row without one, those before and after are as near
_FEWEST = 20  # rows that show whether a log is regular
_IN_TIME = 0.9  # share of a regular log's other rows that come within half a step of their time
_OFTEN = 0.01  # share of gaps: more are of a log of a command that rests now and then
_ROUNDED_TURN = 1e-3  # of a turn, by which readings that were rounded may exceed it
_LOST = 0.005  # share of readings, such as lost packets, that may lie anywhere


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
    if len(times_s) < _FEWEST:
        return False
    lasts = _lasts(times_s)
    is_gap = lasts > BRIDGED
    is_in_time = np.mean(np.abs(lasts[~is_gap] - 1) < 0.5) >= _IN_TIME
    return bool(is_in_time and is_gap.sum() <= max(1, _OFTEN * len(lasts)))


def _lasts(times_s: np.ndarray) -> np.ndarray:
    return np.diff(times_s) / typical_step_s(times_s)


def step_times(rows: Rows, step_s: float) -> np.ndarray:
    """(K + 1,) seconds: starts of the K whole steps that fit into an episode, and the end."""
    begin_s = rows.begin_s
    lasts_s = rows.until_s - begin_s[0]
    row_s = typical_step_s(begin_s) if len(begin_s) > 1 else step_s
    # Of the shorter of both: a share of a long step would reach into what follows the episode.
    spare_s = _ON_TIME * min(row_s, step_s)
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
    if late_s.max() <= (_ROUNDED if is_own_rate else _ON_TIME) * step_s:
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
        inside = _within(values, (1 + _ROUNDED_TURN) * period)
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
    may_lose = math.ceil(_LOST * len(values)) if len(values) >= _FEWEST else 0
    inside = (low <= values) & (values <= low + width)
    return inside & (len(values) - num_held <= may_lose)


def step_readings(rows: Rows, times_s: np.ndarray) -> np.ndarray:
    """(K + 1, D) readings at (K + 1,) times, interpolated linearly between rows.

    NaN before a column's first and after its last, and where more than two in succession are
    missing. On a row without the reading, NaN unless it was read shortly before and after: what
    lacks there is then another clock's row, not a measurement. At another rate than the rows', an
    encoder may be slower than steps, too, and whether these fall on rows is chance.
    """
    own_s, step_s = rows.times_s, times_s[1] - times_s[0]
    row_s = typical_step_s(own_s)
    after = np.searchsorted(own_s, times_s).clip(1, len(own_s) - 1)
    before_s, after_s = own_s[after - 1], own_s[after]
    is_own_rate = _is_same(row_s, step_s)
    nearest_s = np.where(times_s - before_s < after_s - times_s, before_s, after_s)
    is_on_time = np.abs(nearest_s - times_s) <= _ON_TIME * min(row_s, step_s)
    at_s = np.where(is_on_time, nearest_s, times_s)
    found = np.empty((len(times_s), rows.readings.shape[1]))
    for number, column in enumerate(rows.readings.T):
        usual_s = step_s if is_own_rate else max(step_s, own_step_s(own_s, column))
        is_far = gaps_at(at_s, own_s, column) > _NEAR * usual_s
        read = read_between(at_s, own_s, column)
        found[:, number] = np.where(is_on_time & is_far, np.nan, read)
    return found
