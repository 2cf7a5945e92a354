"""Numbers measured at times of their own, read at others on the line between two of them."""

import numpy as np

BRIDGED = 3.5  # of a column's own steps: gaps of up to two missing numbers are interpolated
_FEWEST = 20  # times that show bursts
_BETWEEN = 0.1  # share of gaps: more are between bursts
_WITHIN = 0.15  # of the mean gap: most gaps of a log in bursts are shorter


def typical_step_s(times_s: np.ndarray) -> float:
    """Interval between (T,) rising times, T >= 2, of which a few may be missing.

    Times may come in bursts, as of rows that are stamped when they arrive.
    """
    gaps = np.diff(times_s)
    if len(times_s) >= _FEWEST and (steady_s := _of_bursts(times_s, gaps)):
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
    if np.mean(gaps > BRIDGED * within_s) <= _BETWEEN or within_s > _WITHIN * gaps.mean():
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


def gaps_at(at_s: np.ndarray, times_s: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(K,) seconds between the known numbers before and after each of (K,) times `at_s`.

    `column`: (T,) at (T,) rising times, of which what is not finite is not known. 0 where a number
    is known, infinite before the first and after the last.
    """
    times_s = times_s[np.isfinite(column)]
    ends_s = np.concatenate([[-np.inf], times_s, [np.inf]])
    after = np.searchsorted(times_s, at_s)
    is_known = ends_s[after + 1] == at_s
    return np.where(is_known, 0.0, ends_s[after + 1] - ends_s[after])


def read_between(at_s: np.ndarray, times_s: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(K,) interpolated linearly between a column's known numbers; see `gaps_at`.

    NaN before the first, after the last, and in gaps: relative to the column's own step, since an
    encoder may be slower than rows, and a log may merge the rows of several clocks.
    """
    known = np.isfinite(column)
    if not known.any():
        return np.full(len(at_s), np.nan)
    found = np.interp(at_s, times_s[known], column[known], np.nan, np.nan)
    longest_s = BRIDGED * own_step_s(times_s, column)
    found[gaps_at(at_s, times_s, column) > longest_s] = np.nan
    return found
