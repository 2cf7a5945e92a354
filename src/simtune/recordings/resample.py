"""Resamples rows at recorded times to steps of equal duration."""

import numpy as np

from simtune.recordings.source import Rows

_ON_TIME = 0.02  # of a step: rows this near to a step's start are not resampled
_ROUNDED = 0.25  # of a step: the same, of rows at the steps' own rate, whose clock rounds
_BRIDGED = 3.5  # of the rows' steps: gaps of up to two missing rows are interpolated
_FEWEST = 20  # rows that show whether a log is regular
_IN_TIME = 0.9  # share of a regular log's other rows that come within half a step of their time
_OFTEN = 0.01  # share of gaps: more are of a log of a command that rests now and then
_ROUNDED_TURN = 1e-3  # of a turn, by which readings that were rounded may exceed it


def typical_step_s(times_s: np.ndarray) -> float:
    """Interval between (T,) rising times, T >= 2, of which a few may be missing."""
    gaps = np.diff(times_s)
    # Not just the median, which has the error of clocks that round.
    counts = np.rint(gaps / np.median(gaps)).clip(1)
    return float((times_s[-1] - times_s[0]) / counts.sum())


def find_gaps(times_s: np.ndarray) -> list[tuple[float, float]]:
    """(start, end), in seconds, of gaps of more than two rows in an otherwise regular log.

    `times_s`: (T,) rising. A log of changes alone has none: it is irregular, or rests often.
    """
    if len(times_s) < _FEWEST:
        return []
    lasts = np.diff(times_s) / typical_step_s(times_s)
    is_gap = lasts > _BRIDGED
    is_regular = np.mean(np.abs(lasts[~is_gap] - 1) < 0.5) >= _IN_TIME
    if not is_regular or is_gap.sum() > max(1, _OFTEN * len(lasts)):
        return []
    return [(float(times_s[row]), float(times_s[row + 1])) for row in np.flatnonzero(is_gap)]


def step_times(rows: Rows, step_s: float) -> np.ndarray:
    """(K + 1,) seconds: starts of the K whole steps that fit into an episode, and the end."""
    lasts_s = rows.until_s - rows.times_s[0]
    return rows.times_s[0] + step_s * np.arange(int(lasts_s / step_s + _ON_TIME) + 1)


def step_actions(rows: Rows, times_s: np.ndarray) -> np.ndarray:
    """(K, A) mean action over each step, for (K + 1,) times.

    A recorded action lasts until the next one begins. So shorter steps repeat actions, and longer
    steps average them, which preserves the impulse of a force and the path of a velocity.
    """
    num_steps, step_s = len(times_s) - 1, times_s[1] - times_s[0]
    if len(rows) >= num_steps:
        late_s = np.abs(rows.times_s[:num_steps] - times_s[:-1])
        is_own_rate = len(rows) > 1 and abs(typical_step_s(rows.times_s) / step_s - 1) < 1e-3
        if late_s.max() <= (_ROUNDED if is_own_rate else _ON_TIME) * step_s:
            return rows.actions[:num_steps]
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
    wheel. Periods are in the readings' units, infinite where nothing begins again. NaN: no reading.
    """
    counted = readings.copy()
    for column in np.flatnonzero(np.isfinite(periods)):
        known = np.isfinite(readings[:, column])
        values, period = readings[known, column], float(periods[column])
        if len(values) and np.ptp(values) <= (1 + _ROUNDED_TURN) * period:
            counted[known, column] = np.unwrap(values, period=period)
    return counted


def step_readings(rows: Rows, times_s: np.ndarray) -> np.ndarray:
    """(K + 1, D) readings at (K + 1,) times, interpolated linearly between rows.

    NaN before the first and after the last row, next to a row without the reading, and where more
    than two successive rows are missing.
    """
    own_s, row_s = rows.times_s, typical_step_s(rows.times_s)
    after = np.searchsorted(own_s, times_s).clip(1, len(own_s) - 1)
    before_s, after_s = own_s[after - 1], own_s[after]
    nearest_s = np.where(times_s - before_s < after_s - times_s, before_s, after_s)
    is_on_time = np.abs(nearest_s - times_s) <= _ON_TIME * min(row_s, times_s[1] - times_s[0])
    at_s = np.where(is_on_time, nearest_s, times_s)
    known = np.where(np.isfinite(rows.readings), rows.readings, np.nan)
    columns = [np.interp(at_s, own_s, column, np.nan, np.nan) for column in known.T]
    found = np.reshape(columns, (known.shape[1], len(times_s))).T
    found[~is_on_time & (after_s - before_s > _BRIDGED * row_s)] = np.nan
    return found
