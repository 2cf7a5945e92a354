"""What survival curves say: an estimate with verdicts, and how Ξ moves; pure functions."""

import numpy as np

from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate
from simtune.tuning.search import Event
from simtune.tuning.survival_curves import (
    candidate_grid,
    points_to_keep,
    quantile,
    shortest_interval,
)
from simtune.verdicts import Verdict, verdict_of

_BEYOND_PROBABILITY = 0.05  # past an end of the grid, from which the interval reaches the bound
_MAX_INFORMATIVE_WIDTH = 0.565  # of the range: a curve whose central 90 % is wider says nothing
_EDGE_SHARE = 0.01  # of the range, from its ends
_WIDENED_SHARE = 0.75  # of the range: from the median to an end that is widened
_EDGE_PROBABILITY = 0.1  # beyond its edge, from which a range is widened
MARGIN = 1.6  # narrowed range over the central 98 %, so as not to cut off the posterior
_BARELY_NARROWED = 0.85  # a range that keeps this share of its width is left as it is
SMALLEST_SHARE = 0.06  # of the first range: smallest width of any range


def read_curves(
    prob_higher: np.ndarray, distribution: Distribution, first: Distribution
) -> Estimate:
    """Median, 90 % interval and verdict of (N, C) survival curves on the grid."""
    space, prob_higher = distribution.space, prob_higher.astype(float)

    def parameters(coordinates: np.ndarray) -> np.ndarray:
        return space.clip(distribution.from_range_unit(coordinates))

    mean = parameters(quantile(prob_higher, 0.5))
    low, high = (parameters(end) for end in shortest_interval(prob_higher, 0.9))
    # Probability beyond the grid may be anywhere up to the bound.
    low = np.where(prob_higher[:, 0] < 1 - _BEYOND_PROBABILITY, space.low, low)
    high = np.where(prob_higher[:, -1] > _BEYOND_PROBABILITY, space.high, high)
    share = first.to_range_unit(high) - first.to_range_unit(low)
    verdicts: list[Verdict] = [verdict_of(s) for s in share]
    candidates, curves = parameters(np.repeat(candidate_grid()[:, None], len(space), 1)), {}
    for name, values, row in zip(space.names, candidates.T, prob_higher, strict=True):
        kept = points_to_keep(row)
        curves[name] = (values[kept], row[kept])
    return Estimate(mean, low, high, verdicts, curves)


def update_range(
    prob_higher: np.ndarray, distribution: Distribution, first: Distribution
) -> tuple[Distribution, list[Event]]:
    """Move to the median; narrow the range if the curve is sharp, widen it if it hits an edge."""
    space, median = distribution.space, quantile(prob_higher, 0.5)
    # Half of the smallest width allowed, in coordinates of the present range
    old_width = first.to_range_unit(distribution.high) - first.to_range_unit(distribution.low)
    smallest = SMALLEST_SHARE / old_width / 2
    middle, half = _middle_and_half(prob_higher)
    half = np.maximum(half, smallest)
    is_kept = 2 * half > _BARELY_NARROWED
    is_widened = _is_beyond(prob_higher) & _is_informative(prob_higher)
    low, high = np.select(
        [is_widened, is_kept],
        [np.stack([median - _WIDENED_SHARE, median + _WIDENED_SHARE]), [[0.0], [1.0]]],
        _narrowed(middle, half, smallest),
    )
    ends = (np.clip(median, low, high), low, high)
    updated = distribution.with_interval(
        *(space.clip(distribution.from_range_unit(end)) for end in ends)
    )
    return updated, _events(distribution, updated)


def _middle_and_half(prob_higher: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) middle and (N,) half width, with a margin, of the central 98 %."""
    low, high = quantile(prob_higher, 0.01), quantile(prob_higher, 0.99)
    return (low + high) / 2, MARGIN * (high - low) / 2


def _is_beyond(prob_higher: np.ndarray) -> np.ndarray:
    """(2, N) bool: whether the posterior may go on below, and above the range."""
    below = quantile(prob_higher, _EDGE_PROBABILITY) < _EDGE_SHARE
    above = quantile(prob_higher, 1 - _EDGE_PROBABILITY) > 1 - _EDGE_SHARE
    return np.stack([below, above])


def _is_informative(prob_higher: np.ndarray) -> np.ndarray:
    """(N,) bool: not of a flat curve, whose quantiles at the edges mean nothing.

    The central 90 % excludes the tails that a fit's mixture has from the network.
    """
    return quantile(prob_higher, 0.95) - quantile(prob_higher, 0.05) < _MAX_INFORMATIVE_WIDTH


def _narrowed(middle: np.ndarray, half: np.ndarray, smallest: np.ndarray) -> np.ndarray:
    """(2, N) ends of a range that is `half` as wide, within 0 and 1, but not below `smallest`.

    Also at an edge, or with all of the posterior beyond it.
    """
    low, high = np.maximum(middle - half, 0), np.minimum(middle + half, 1)
    middle = np.clip((low + high) / 2, smallest, 1 - smallest)
    return np.stack([np.minimum(low, middle - smallest), np.maximum(high, middle + smallest)])


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
