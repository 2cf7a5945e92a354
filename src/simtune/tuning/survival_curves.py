"""Survival curves on a grid: how they are made, combined, and read.

The grid is in coordinates of the range: 0 at its low end, 1 at its high end.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from simtune.fit import PointEstimate
from simtune.randomization import Distribution

_GRID = np.linspace(-0.25, 1.25, 12001)  # finer than a fit is sharp; linear in between
_SMALLEST_STD = 5e-5
_NET_SHARE = 0.04  # of the posterior network in a mixture, for the case that the fit failed
_MIN_STD_POINTS = 0.1  # of the grid: a smaller standard deviation changes no curve
# Points of a curve that are kept, for plots and draws: every so many, and those where it has fallen
# to these values.
_KEPT_EVERY, _KEPT_AT = 80, ndtr(np.linspace(4, -4, 161))


def candidate_grid() -> np.ndarray:
    """(C,) candidates at which curves are read, in coordinates of the range."""
    return _GRID


def point_estimate(prob_higher: np.ndarray, distribution: Distribution) -> PointEstimate:
    """Medians of (N, C) curves, and half the width of their central 68 %."""
    space = distribution.space
    middle = distribution.from_range_unit(quantile(prob_higher, 0.5))
    spread = quantile(prob_higher, 0.84) - quantile(prob_higher, 0.16)
    return PointEstimate(space.clip(middle), spread / 2 * distribution.unit_width)


def with_fit(prob_higher: np.ndarray, mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(N, C) mixture of the posterior network's curves and a fit's normal ones.

    `mean`, `std`: (N,) of the fit in coordinates of the range.
    """
    return _NET_SHARE * prob_higher + (1 - _NET_SHARE) * normal_curves(mean, std)


def normal_curves(mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(N, C) on the grid, from (N,) means and standard deviations in coordinates of the range."""
    return ndtr((mean[:, None] - _GRID) / np.maximum(std[:, None], _SMALLEST_STD))


def blurred(prob_higher: np.ndarray, std: np.ndarray, distribution: Distribution) -> np.ndarray:
    """(N, C) curves with independent normal errors added, of (N,) `std` in unit coordinates."""
    points = std / distribution.unit_width / (_GRID[1] - _GRID[0])
    rows = zip(prob_higher, np.where(points > _MIN_STD_POINTS, points, 0), strict=True)
    return np.stack([gaussian_filter1d(row, n, mode="nearest") if n else row for row, n in rows])


def quantile(prob_higher: np.ndarray, share: float) -> np.ndarray:
    """(N,) coordinates below which the truth lies with probability `share`.

    `prob_higher`: (N, C) survival curves on the grid, which fall from 1 to 0.
    """
    return _quantiles(prob_higher, np.array([share]))[0]


def _quantiles(prob_higher: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(S, N) the same for (S,) shares."""
    below = 1 - np.minimum.accumulate(prob_higher, axis=1)
    return np.stack([np.interp(shares, row, _GRID) for row in below], -1)


def shortest_interval(prob_higher: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """(N,) ends of the shortest interval that holds the truth with probability `share`.

    It reaches a bound if the truth may lie there; equal tails never would.
    """
    below = np.linspace(0.002, 1 - share - 0.002, 33)
    low, high = np.split(_quantiles(prob_higher, np.concatenate([below, below + share])), 2)
    shortest = (high - low).argmin(0)[None]
    return np.take_along_axis(low, shortest, 0)[0], np.take_along_axis(high, shortest, 0)[0]


def points_to_keep(prob_higher: np.ndarray) -> np.ndarray:
    """(C,) bool: points of a curve on the grid to keep for plots and draws."""
    is_kept = np.arange(len(prob_higher)) % _KEPT_EVERY == 0
    fallen = np.searchsorted(1 - np.minimum.accumulate(prob_higher), 1 - _KEPT_AT)
    last = len(prob_higher) - 1
    is_kept[np.minimum(fallen, last)] = is_kept[np.maximum(fallen - 1, 0)] = True
    return is_kept
