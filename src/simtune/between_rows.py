"""Numbers measured at times of their own, read at others on a curve through them."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

BRIDGED = 3.5  # of a column's own steps: gaps of up to two missing numbers are interpolated
_SLOPE_NUMBERS = 5  # neighbours that tell a curve's slope
_BURST_SHARE = 0.25  # of the usual interval: nearer neighbours tell no slope
_TIE = 1e-6  # of a step: halfway between two steps, rounding does not choose one
_MIN_BURST_TIMES = 20  # fewer show no bursts
_BURST_GAP_SHARE = 0.1  # of gaps: more are between bursts
_INNER_GAP_RATIO = 0.15  # to the mean gap: most gaps of a log in bursts are shorter


def typical_step_s(times_s: np.ndarray) -> float:
    """Interval between (T,) rising times, T >= 2, of which a few may be missing.

    Times may come in bursts, as of rows that are stamped when they arrive.
    """
    gaps = np.diff(times_s)
    if len(times_s) >= _MIN_BURST_TIMES and (steady_s := _of_bursts(times_s, gaps)):
        return steady_s
    # Not just the median, which has the error of clocks that round.
    counts = np.rint(gaps / np.median(gaps)).clip(1)
    return float((times_s[-1] - times_s[0]) / counts.sum())


def _of_bursts(times_s: np.ndarray, gaps: np.ndarray) -> float | None:
    """Seconds from row to row if rows were stamped in bursts as they arrived; else None.

    Such rows come at a steady rate on the whole, none later than the longest gap. Those of a
    command that changes now and then do not.
    """
    within_s = np.sort(gaps)[(len(gaps) - 1) // 2]  # of pairs: not midway between long and short
    if (
        np.mean(gaps > BRIDGED * within_s) <= _BURST_GAP_SHARE
        or within_s > _INNER_GAP_RATIO * gaps.mean()
    ):
        return None
    rows = np.arange(len(times_s))
    line = np.polyfit(rows, times_s, 1)
    is_steady = np.abs(times_s - np.polyval(line, rows)).max() <= gaps.max()
    return float(line[0]) if is_steady else None


def own_step_s(times_s: np.ndarray, column: np.ndarray) -> float:
    """Interval between the known numbers of a (T,) column at (T,) rising times.

    0 if fewer than two are known.
    """
    known = np.isfinite(column)
    return typical_step_s(times_s[known]) if known.sum() > 1 else 0.0


def read_between(at_s: np.ndarray, times_s: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(K,) at rising times `at_s`, on a curve through the known numbers of a (T,) column.

    `times_s`: (T,) rising; what is not finite is not known. NaN before the first known number,
    after the last, and in gaps: relative to the column's own step, since an encoder may be slower
    than rows, and a log may merge the rows of several clocks.
    """
    found, known = np.full(len(at_s), np.nan), np.isfinite(column)
    if not known.any():
        return found
    longest_s = BRIDGED * own_step_s(times_s, column)
    known_s, values = times_s[known], column[known]
    gaps = np.flatnonzero(np.diff(known_s) > longest_s) + 1
    for run_s, run in zip(np.split(known_s, gaps), np.split(values, gaps), strict=True):
        inside = slice(np.searchsorted(at_s, run_s[0]), np.searchsorted(at_s, run_s[-1], "right"))
        found[inside] = _on_curve(at_s[inside], run_s, run)
    return found


def read_nearest(
    at_s: np.ndarray, times_s: np.ndarray, column: np.ndarray, rounding_s: float
) -> np.ndarray:
    """(K,) as `read_between`, but only at those of K even times that are nearest to a known number.

    So there are no more numbers than were measured, each moved by half a step at most: between
    measurements farther apart, nobody knows. One within `rounding_s` of its time is not moved.
    """
    known = np.isfinite(column)
    known_s, values = times_s[known], column[known]
    step_s = at_s[1] - at_s[0] if len(at_s) > 1 else np.inf
    places = np.floor((known_s - at_s[0]) / step_s + 0.5 + _TIE).astype(int)
    is_there = (places >= 0) & (places < len(at_s))
    places, known_s, values = places[is_there], known_s[is_there], values[is_there]
    found = np.full(len(at_s), np.nan)
    found[places] = read_between(at_s, times_s, column)[places]
    is_on_time = np.abs(at_s[places] - known_s) <= rounding_s
    found[places[is_on_time]] = values[is_on_time]
    return found


def _on_curve(at_s: np.ndarray, times_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(K,) at times within those of a run of (N,) numbers without gaps.

    Cubic, with the slopes of polynomials through five neighbours: a straight line errs by more than
    an encoder's noise (6 mrad at 20 rad/s² and 20 rows a second), and in a spline a lost packet
    would spread over ten rows. A line where numbers came in bursts: these tell no slope.
    """
    num = len(times_s)
    if num == 1:
        return np.full(len(at_s), values[0])
    usual_s = (times_s[-1] - times_s[0]) / (num - 1)
    width = min(_SLOPE_NUMBERS, num)
    first = np.clip(np.arange(num) - width // 2, 0, num - width)
    near = first[:, None] + np.arange(width)
    away = (times_s[near] - times_s[:, None]) / usual_s
    powers = away[..., None] ** np.arange(width)
    slopes = np.linalg.solve(powers, values[near][..., None])[:, 1, 0] / usual_s
    curve = CubicHermiteSpline(times_s, values, slopes)(at_s)
    is_burst = np.diff(away, axis=1).min(1) < _BURST_SHARE
    before = np.searchsorted(times_s, at_s, "right").clip(1, num - 1) - 1
    is_rough = is_burst[before] | is_burst[before + 1]
    return np.where(is_rough, np.interp(at_s, times_s, values), curve)
