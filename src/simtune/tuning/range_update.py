"""How Ξ moves, given survival curves: pure functions.

Curves are read on a grid in coordinates of the range: 0 at its low end, 1 at its high end.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from simtune.fit import PointEstimate
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate, Verdict, at_most_weak
from simtune.tuning.search import Event

_BEYOND = 0.05  # probability beyond an end of the grid, from which the interval reaches the bound
_INFORMATIVE = 0.565  # of the range: a curve whose central 90 % is wider says nothing
_GRID = np.linspace(-0.25, 1.25, 12001)  # finer than a fit is sharp; linear in between
_EDGE = 0.01  # of the range, from its ends
_SMALLEST_STD = 5e-5
_FEWEST_POINTS = 0.1  # of the grid: a smaller standard deviation changes no curve
_AT_EDGE = (
    "The truth may lie beyond the range that was searched of {}, which no fit can follow here, so "
    "that is not called identified. Another round searches beyond: give it more minutes."
)
# Points of a curve that are kept, for plots and draws: every so many, and those where it has fallen
# to these values.
_KEPT_EVERY, _KEPT_AT = 80, ndtr(np.linspace(4, -4, 161))


@dataclass(frozen=True, kw_only=True)
class RangeUpdateConfig:
    edge_mass: float = 0.1  # probability beyond its edge from which a range is widened
    margin: float = 1.6  # narrowed range over the central 98 %, so as not to cut off the posterior
    barely_narrowed: float = 0.85  # a range that keeps this share of its width is left as it is
    smallest_share: float = 0.06  # of the first range: smallest width of any range
    # Width of the 90 % interval over the first range for "identified"; ±10 % on a log scale
    identified_share: float = 0.09
    weak_share: float = 0.6  # ... and up to here "weak"
    posterior_net_weight: float = 0.04  # for the case that the fit failed


def candidate_grid() -> np.ndarray:
    """(C,) candidates at which curves are read, in coordinates of the range."""
    return _GRID


def point_estimate(prob_higher: np.ndarray, distribution: Distribution) -> PointEstimate:
    """Medians of (N, C) curves, and half the width of their central 68 %."""
    space = distribution.space
    middle = distribution.from_range_unit(quantile(prob_higher, 0.5))
    spread = quantile(prob_higher, 0.84) - quantile(prob_higher, 0.16)
    return PointEstimate(space.clip(middle), spread / 2 * distribution.unit_width)


def with_fit(
    prob_higher: np.ndarray, mean: np.ndarray, std: np.ndarray, config: RangeUpdateConfig
) -> np.ndarray:
    """(N, C) mixture of the posterior network's curves and a fit's normal ones.

    `mean`, `std`: (N,) of the fit in coordinates of the range.
    """
    weight = config.posterior_net_weight
    return weight * prob_higher + (1 - weight) * normal_curves(mean, std)


def normal_curves(mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(N, C) on the grid, from (N,) means and standard deviations in coordinates of the range."""
    return ndtr((mean[:, None] - _GRID) / np.maximum(std[:, None], _SMALLEST_STD))


def blurred(prob_higher: np.ndarray, std: np.ndarray, distribution: Distribution) -> np.ndarray:
    """(N, C) curves with independent normal errors added, of (N,) `std` in unit coordinates."""
    points = std / distribution.unit_width / (_GRID[1] - _GRID[0])
    rows = zip(prob_higher, np.where(points > _FEWEST_POINTS, points, 0), strict=True)
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


def read_curves(
    prob_higher: np.ndarray,
    distribution: Distribution,
    first: Distribution,
    config: RangeUpdateConfig,
) -> Estimate:
    """Median, 90 % interval and verdict of (N, C) survival curves on the grid."""
    space, prob_higher = distribution.space, prob_higher.astype(float)

    def parameters(coordinates: np.ndarray) -> np.ndarray:
        return space.clip(distribution.from_range_unit(coordinates))

    mean = parameters(quantile(prob_higher, 0.5))
    low, high = (parameters(end) for end in shortest_interval(prob_higher, 0.9))
    # Probability beyond the grid may be anywhere up to the bound.
    low = np.where(prob_higher[:, 0] < 1 - _BEYOND, space.low, low)
    high = np.where(prob_higher[:, -1] > _BEYOND, space.high, high)
    share = first.to_range_unit(high) - first.to_range_unit(low)
    verdicts: list[Verdict] = [_verdict(s, config) for s in share]
    candidates, curves = parameters(np.repeat(_GRID[:, None], len(space), 1)), {}
    for name, values, row in zip(space.names, candidates.T, prob_higher, strict=True):
        kept = _telling(row)
        curves[name] = (values[kept], row[kept])
    return Estimate(mean, low, high, verdicts, curves)


def doubted_at_edges(estimate: Estimate, events: list[Event]) -> Estimate:
    """The estimate; parameters at an edge of the searched range are at most weak, with a warning.

    Networks say little of what lies beyond the range that they were trained in.
    """
    widened = [event.parameter for event in events if event.event == "widened"]
    if not widened:
        return estimate
    names = list(estimate.curves)
    return replace(
        estimate,
        verdict=at_most_weak(estimate.verdict, np.array([name in widened for name in names])),
        warnings=[*estimate.warnings, _AT_EDGE.format(", ".join(widened))],
    )


def _telling(prob_higher: np.ndarray) -> np.ndarray:
    """(C,) bool: points of a curve on the grid to keep for plots and draws."""
    is_kept = np.arange(len(prob_higher)) % _KEPT_EVERY == 0
    fallen = np.searchsorted(1 - np.minimum.accumulate(prob_higher), 1 - _KEPT_AT)
    last = len(prob_higher) - 1
    is_kept[np.minimum(fallen, last)] = is_kept[np.maximum(fallen - 1, 0)] = True
    return is_kept


def _verdict(share: float, config: RangeUpdateConfig) -> Verdict:
    if share <= config.identified_share:
        return "identified"
    return "weak" if share <= config.weak_share else "not identifiable"


def update_range(
    prob_higher: np.ndarray,
    distribution: Distribution,
    first: Distribution,
    config: RangeUpdateConfig,
) -> tuple[Distribution, list[Event]]:
    """Move to the median; narrow the range if the curve is sharp, widen it if it hits an edge."""
    space = distribution.space
    # Half of the smallest width allowed, in coordinates of the present range
    old_width = first.to_range_unit(distribution.high) - first.to_range_unit(distribution.low)
    smallest = config.smallest_share / old_width / 2
    median = quantile(prob_higher, 0.5)
    q_low, q_high = quantile(prob_higher, 0.01), quantile(prob_higher, 0.99)
    half = np.clip(config.margin * (q_high - q_low) / 2, smallest, 0.5)
    middle = (q_low + q_high) / 2
    low, high = np.maximum(middle - half, 0), np.minimum(middle + half, 1)
    # Also at an edge, or with all of the posterior beyond it:
    middle = np.clip((low + high) / 2, smallest, 1 - smallest)
    low, high = np.minimum(low, middle - smallest), np.maximum(high, middle + smallest)
    beyond_low = quantile(prob_higher, config.edge_mass) < _EDGE
    beyond_high = quantile(prob_higher, 1 - config.edge_mass) > 1 - _EDGE
    # A flat curve has quantiles at the edges, but they mean nothing. The central 90 % excludes the
    # tails that a fit's mixture has from the network.
    central = quantile(prob_higher, 0.95) - quantile(prob_higher, 0.05)
    is_informative = central < _INFORMATIVE
    is_kept = 2 * half > config.barely_narrowed
    low, high = np.where(is_kept, 0, low), np.where(is_kept, 1, high)
    low = np.where(beyond_low & is_informative, median - 0.75, low)
    high = np.where(beyond_high & is_informative, median + 0.75, high)
    ends = (np.clip(median, low, high), low, high)
    updated = distribution.with_interval(
        *(space.clip(distribution.from_range_unit(end)) for end in ends)
    )
    return updated, _events(distribution, updated)


def _events(before: Distribution, after: Distribution) -> list[Event]:
    """Ranges that were widened, or narrowed by more than a twentieth."""
    events = []
    low, high = before.to_range_unit(after.low), before.to_range_unit(after.high)
    for i, name in enumerate(before.space.names):
        now = (name, float(after.low[i]), float(after.high[i]))
        if low[i] < -0.01 or high[i] > 1.01:
            events.append(Event("widened", *now, "the truth may lie beyond the edge of the range"))
        elif high[i] - low[i] < 0.95:
            events.append(Event("narrowed", *now, "the videos rule the rest out"))
    return events
