"""Ξ_policy: the worlds in which a policy is trained (Sec. III)."""

import numpy as np

from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate

WIDER = 2.0  # factor on a 90 % interval: the interval, and a margin as large
_MIN_RANGE_SHARE = 0.2  # of the whole range: no simulator is right in everything


def policy_range(distribution: Distribution, estimate: Estimate, range_: float) -> Distribution:
    """A search's distribution to Ξ_policy, a share of `range_` around its mean as in the paper.

    The paper's range is the same for all parameters, at all times. Here those that are identified
    are drawn from twice their interval, at most from all of the range, at least from a fifth of it:
    a policy that need not act in worlds that are ruled out acts better in the one that is left.
    """
    mean = distribution.mean
    widest = distribution.around(mean, range_)
    least = distribution.around(mean, _MIN_RANGE_SHARE * range_)
    known = np.array([verdict == "identified" for verdict in estimate.verdict])
    low = mean - WIDER * (estimate.mean - estimate.low)
    high = mean + WIDER * (estimate.high - estimate.mean)
    return widest.with_interval(
        mean,
        np.where(known, np.clip(low, widest.low, least.low), widest.low),
        np.where(known, np.clip(high, least.high, widest.high), widest.high),
    )
