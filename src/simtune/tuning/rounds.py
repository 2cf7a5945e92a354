"""How long a round may take, and when another one is not worth its time: pure functions."""

import numpy as np

from simtune.randomization import Distribution
from simtune.tuning.search import Estimate

_LONGER = 1.5  # a round that learns more than the first, in terms of that
_WORTHWHILE = 0.8  # of the last interval: what a new one must be within, to go on


def plan_round(seconds_left: float, full_s: float, is_last: bool) -> float:
    """Seconds for the next round, where a whole first one takes `full_s`.

    All that is left, if that is not enough for two: one that is sound tells more than two that
    are not.
    """
    if is_last or seconds_left < (1 + _LONGER) * full_s:
        return seconds_left
    return min(_LONGER * full_s, seconds_left / 2)


def half_widths(estimate: Estimate, first: Distribution) -> np.ndarray:
    """(N,) half of each 90 % interval: relative to the estimate, or where that may be 0 or less,
    relative to the first range.
    """
    half = (estimate.high - estimate.low) / 2
    is_scale = first.space.low >= 0
    size = np.where(is_scale, np.abs(estimate.mean), first.high - first.low)
    return half / np.maximum(size, 1e-12)


def is_precise(widths: np.ndarray, precision: float) -> bool:
    """Whether (N,) half-widths say that every parameter is known so well."""
    return bool((widths <= precision).all())


def gains_nothing(before: np.ndarray, now: np.ndarray, precision: float) -> bool:
    """Whether a round made no interval much narrower, of (N,) that are not narrow enough."""
    return bool(((now > _WORTHWHILE * before) | (now <= precision)).all())
