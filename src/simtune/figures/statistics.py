"""What several seeds say together: interquartile means and bootstrap intervals.

As Agarwal et al. 2021 ("Deep reinforcement learning at the edge of the statistical precipice")
recommend: the interquartile mean, which a lucky or an unlucky seed does not move, and percentile
bootstrap intervals, for several tasks stratified by task. With less than four values in all
nothing can be left out, and it is the mean.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

_RESAMPLES = 2000  # of scipy's default of 95 %


class Centre(NamedTuple):
    """An interquartile mean and its 95 % interval, and of how many values."""

    mean: float
    low: float
    high: float
    num: int  # values


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """The mean without the lowest and the highest quarter, rounded down."""
    return stats.trim_mean(values, 0.25, axis=axis)


def centre(values: Sequence[float]) -> Centre:
    """Of the values of some seeds; of a single one the interval is unknown, NaN."""
    return stratified([values])


def stratified(strata: Sequence[Sequence[float]]) -> Centre:
    """The same over the values of several tasks, seeds being drawn anew within each task."""
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
