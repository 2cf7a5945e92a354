"""Percent errors of estimates beside known truths."""

from typing import Any

import numpy as np

FLOOR = 0.01  # share of the bound that is farther from 0; a smaller truth counts as this


def percent_error(mean: Any, real: Any, farthest_bound: Any) -> np.ndarray:
    """(N,) 100·|mean − real| / |real| of (N,) estimates and truths, or of a single one.

    Divided by at least a hundredth of the bound that is farther from 0: a truth may be 0 (black).
    NaN where that bound is 0, too.
    """
    mean, real, bound = np.broadcast_arrays(mean, real, farthest_bound)
    size = np.maximum(np.abs(real), FLOOR * np.abs(bound))
    return np.divide(
        100 * np.abs(mean - real), size, out=np.full(size.shape, np.nan), where=size > 0
    )
