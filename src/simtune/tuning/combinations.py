"""Combinations of two correlated parameters that the videos determine better than either.

If the errors of two rise together, their ratio is known best, else their product; for parameters
that may be negative, their difference or sum. Weights are the ratio of interval widths: a / b² if
log a is twice as uncertain as log b. Intervals are from draws of the joint posterior.

Camera positions and orientations have none: powers of a position mean nothing, and metres and
radians cannot be added.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from simtune.parameters import ParameterSpace
from simtune.tuning.estimate import Estimate

Kind = Literal["ratio", "product", "difference", "sum"]

_ABOUT_ONE = (0.75, 1.33)
_LARGEST_POWER = 5.0
_TINY = 1e-300  # lower bound for logarithms


@dataclass(frozen=True, kw_only=True)
class Combination:
    """a / b^weight, a · b^weight, a − weight · b or a + weight · b."""

    a: str
    b: str
    kind: Kind
    weight: float
    correlation: float  # of the errors of a and b
    mean: float  # the median, as for a parameter's estimate
    low: float  # lower end of the central 90 %
    high: float


def combinations(estimate: Estimate, space: ParameterSpace, draws: np.ndarray) -> list[Combination]:
    """For the pairs that an estimate lists as correlated; `draws` (num, N) of its joint posterior.

    None for a pair with only one log scale, or with two linear ones of different units.
    """
    found = []
    for names, correlation in estimate.correlations.items():
        a, _, b = names.partition(", ")
        found.append(_combine(estimate, space, draws, a, b, correlation))
    return [combination for combination in found if combination]


def rounded_weight(weight: float) -> float:
    """A combination's weight to one digit; 1 if it is near 1."""
    return 1.0 if _ABOUT_ONE[0] < weight < _ABOUT_ONE[1] else float(f"{weight:.1g}")


def is_useful_power(weight: float) -> bool:
    """Of a ratio or a product: beyond, it says hardly more than one parameter alone."""
    return 1 / _LARGEST_POWER <= weight <= _LARGEST_POWER


def _combine(
    estimate: Estimate, space: ParameterSpace, draws: np.ndarray, a: str, b: str, correlation: float
) -> Combination | None:
    pair = [space.index(a), space.index(b)]
    low, high, values = estimate.low[pair], estimate.high[pair], draws[:, pair]
    rise, in_logs = correlation > 0, _is_of_powers(space, pair, low)
    kind: Kind = ("ratio" if rise else "product") if in_logs else "difference" if rise else "sum"
    units = {space.parameters[i].unit for i in pair}
    if not in_logs and (space.is_log[pair].any() or len(units) > 1):
        return None
    if in_logs:
        low, high, values = (np.log(np.maximum(part, _TINY)) for part in (low, high, values))
    width = high - low
    if not (width > 0).all():
        return None
    is_colour = space.is_colour[pair].all()  # of one channel, under the same light
    weight = 1.0 if is_colour else rounded_weight(float(width[0] / width[1]))
    if in_logs and not is_useful_power(weight):
        return None
    quantiles = np.quantile(values @ [1, -weight if rise else weight], (0.5, 0.05, 0.95))
    middle, lower, upper = (float(value) for value in (np.exp(quantiles) if in_logs else quantiles))
    return Combination(
        a=a,
        b=b,
        kind=kind,
        weight=weight,
        correlation=correlation,
        mean=middle,
        low=lower,
        high=upper,
    )


def _is_of_powers(space: ParameterSpace, pair: list[int], low: np.ndarray) -> bool:
    """Whether both are positive factors: on a log scale, or colours or light."""
    are_factors = space.is_log[pair] | space.is_appearance[pair]
    return bool(are_factors.all() and (low > 0).all())
