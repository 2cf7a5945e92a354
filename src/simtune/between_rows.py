"""Numbers measured at times of their own, read at others on the line between two of them."""

import numpy as np

BRIDGED = 3.5  # of a column's own steps: gaps of up to two missing numbers are interpolated


def typical_step_s(times_s: np.ndarray) -> float:
    """Interval between (T,) rising times, T >= 2, of which a few may be missing."""
    gaps = np.diff(times_s)
    # Not just the median, which has the error of clocks that round.
    counts = np.rint(gaps / np.median(gaps)).clip(1)
    return float((times_s[-1] - times_s[0]) / counts.sum())


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
    if known.sum() > 1:
        longest_s = BRIDGED * typical_step_s(times_s[known])
        found[gaps_at(at_s, times_s, column) > longest_s] = np.nan
    return found
