"""Parameters that only show together: what the videos do tell of two, and its interval.

Where errors of two rise together their ratio is known best, else their product; of what may be
negative, their difference or their sum. Each counts by how wide its own interval is: a / b² where
log a is twice as unsure as log b. Intervals are of draws of the joint posterior.

Where a camera stands and how it is turned has neither: powers of a place mean nothing, and metres
and radians add to nothing.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from simtune.parameters import ParameterSpace
from simtune.tuning.search import Estimate

Kind = Literal["ratio", "product", "difference", "sum"]

_ABOUT_ONE = (0.75, 1.33)
_LARGEST_POWER = 5.0  # of which anybody can make use
_TINY = 1e-300  # what may be zero has a logarithm, too


@dataclass(frozen=True, kw_only=True)
class Combination:
    """a / b^weight, a · b^weight, a − weight · b or a + weight · b."""

    a: str
    b: str
    kind: Kind
    weight: float
    correlation: float  # of the errors of a and b
    mean: float  # the median, as of a parameter's estimate
    low: float  # lower end of the central 90 %
    high: float


def combinations(estimate: Estimate, space: ParameterSpace, draws: np.ndarray) -> list[Combination]:
    """Of the pairs that an estimate calls correlated; `draws` (num, N) of its joint posterior.

    A pair has none where only one is of a log scale, or where both are linear and of other units.
    """
    found = []
    for names, correlation in estimate.correlations.items():
        a, _, b = names.partition(", ")
        found.append(_combine(estimate, space, draws, a, b, correlation))
    return [combination for combination in found if combination]


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
    is_colour = space.is_colour[pair].all()  # of one channel, so that one light is on both
    weight = 1.0 if is_colour else _rounded(float(width[0] / width[1]))
    if in_logs and not 1 / _LARGEST_POWER <= weight <= _LARGEST_POWER:
        return None
    said = np.quantile(values @ [1, -weight if rise else weight], (0.5, 0.05, 0.95))
    middle, lower, upper = (float(value) for value in (np.exp(said) if in_logs else said))
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
    """Whether both are of log scales; or colours or light, of which half as much is meant, too."""
    are_factors = space.is_log[pair] | space.is_appearance[pair]
    return bool(are_factors.all() and (low > 0).all())


def _rounded(weight: float) -> float:
    """To one digit; 1 where it is about that."""
    return 1.0 if _ABOUT_ONE[0] < weight < _ABOUT_ONE[1] else float(f"{weight:.1g}")
