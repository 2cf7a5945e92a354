"""Statistics over several seeds: interquartile means and bootstrap intervals.

As recommended by Agarwal et al. 2021 ("Deep reinforcement learning at the edge of the statistical
precipice"): the interquartile mean, which a lucky or unlucky seed does not change, and percentile
bootstrap intervals, stratified by task for several tasks. With fewer than four values, nothing is
trimmed, and the result is the mean. A bootstrap of fewer than five values says no more than how far
apart they lie, so their interval is that: from the lowest to the highest.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

_RESAMPLES = 2000  # for intervals of 95 %, scipy's default
_MIN_INTERVAL_VALUES = 5  # fewer have no bootstrap interval


class Centre(NamedTuple):
    """An interquartile mean and its interval: of 95 %, or of few values from lowest to highest."""

    mean: float
    low: float
    high: float
    num: int  # number of values


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """The mean without the lowest and the highest quarter; the quarter is rounded down."""
    return stats.trim_mean(values, 0.25, axis=axis)


def centre(values: Sequence[float]) -> Centre:
    """Centre of the values of several seeds; the interval of a single one is NaN."""
    if not 1 < len(values) < _MIN_INTERVAL_VALUES:
        return stratified([values])
    mean = float(interquartile_mean(np.asarray(values, float)))
    return Centre(mean, float(min(values)), float(max(values)), len(values))


def stratified(strata: Sequence[Sequence[float]]) -> Centre:
    """Centre of the values of several tasks; seeds are resampled within each task."""
    arrays = [np.asarray(values, float) for values in strata]
    varied = [values for values in arrays if len(values) > 1]
    alone = np.concatenate([np.zeros(0), *(values for values in arrays if len(values) < 2)])

    def statistic(*samples: np.ndarray, axis: int = -1) -> np.ndarray:
        fixed = np.broadcast_to(alone, (*samples[0].shape[:-1], len(alone)))
        return interquartile_mean(np.concatenate([*samples, fixed], axis=-1), axis)

    mean, num = float(interquartile_mean(np.concatenate(arrays))), sum(map(len, arrays))
    if not varied:
        return Centre(mean, np.nan, np.nan, num)
    found = stats.bootstrap(varied, statistic, n_resamples=_RESAMPLES, method="percentile", rng=0)
    low, high = found.confidence_interval
    return Centre(mean, float(low), float(high), num)
