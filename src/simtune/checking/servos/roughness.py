"""Noise of readings by how rough they are, without a model of how their joints move."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.normal import MAD_TO_STD

# Of differences: smooth motion leaves less in higher ones, noise as much
_ORDERS = range(2, 7)
_FINEST = 1e-5  # of a joint's travel: no encoder is finer


def roughness(episodes: Sequence[np.ndarray]) -> float:
    """Standard deviation of white noise in a joint's (T + 1,) readings; NaN where nothing is read.

    The k-th differences of noise have binomial(2k, k) times its variance. Motion adds to them, so
    the order that leaves least counts, by its median, as jerks are few. Readings are no finer than
    their steps, which are half a step off at most. NaN if they never change.
    """
    changes = np.concatenate([np.abs(np.diff(values)) for values in episodes])
    values = np.concatenate(list(episodes))
    travel = np.ptp(values[np.isfinite(values)]) if np.isfinite(values).any() else 0.0
    if not travel > 0:
        return math.nan
    step = changes[changes > _FINEST * travel].min(initial=travel)
    left = [_by_differences(episodes, order) for order in _ORDERS]
    return float(max(step / math.sqrt(12), np.nanmin([*left, travel])))


def _by_differences(episodes: Sequence[np.ndarray], order: int) -> float:
    """By differences of one order, NaN if no readings follow each other that long."""
    of_all = np.concatenate([np.diff(values, order) for values in episodes])
    known = np.abs(of_all[np.isfinite(of_all)])
    if not len(known):
        return math.nan
    return float(MAD_TO_STD * np.median(known) / math.sqrt(math.comb(2 * order, order)))
