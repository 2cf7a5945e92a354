"""How the paper's search moves ξ_mean: pure functions."""

import numpy as np

from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution, size_of
from simtune.tuning.search import Event


def shift_mean(
    mean: np.ndarray,
    prob_higher: np.ndarray,
    step_size: float,
    space: ParameterSpace,
    start: np.ndarray | None = None,
) -> np.ndarray:
    """ξ_mean + α·(p̄ − ½)·ξ_mean: up to half of α up or down (Algorithm 1, last line).

    The paper adds α·q_φ, which could only grow. Its authors' code subtracts ½, as here. What is 0
    at the `start` moves by a share of a tenth of its bounds, see `size_of`.
    """
    size = size_of(space, mean, start)
    return _keep_in_bounds(mean + step_size * (prob_higher - 0.5) * size, space)


def approach(
    mean: np.ndarray, prediction: np.ndarray, step_size: float, space: ParameterSpace
) -> np.ndarray:
    """(1 − α)·ξ_mean + α·prediction: the regression baseline (Sec. VI-A)."""
    return _keep_in_bounds((1 - step_size) * mean + step_size * prediction, space)


def _keep_in_bounds(mean: np.ndarray, space: ParameterSpace) -> np.ndarray:
    return np.maximum(space.clip(mean), _lowest(space))


def _lowest(space: ParameterSpace) -> np.ndarray:
    """(N,) smallest values of a mean."""
    # A proportional step cannot leave 0; for colours this is the authors' floor of 1e-3.
    return np.where(space.low > 0, space.low, 1e-3 * space.high)


def arrivals(before: np.ndarray, now: Distribution) -> list[Event]:
    """An event for each parameter whose mean has reached a bound; means move in every round."""
    events = []
    lowest, highest = _lowest(now.space), now.space.high
    for i, parameter in enumerate(now.space):
        for bound, side in ((lowest[i], "lower"), (highest[i], "upper")):
            if now.mean[i] == bound != before[i]:
                reason = f"its mean has come to the {side} bound"
                low, high = float(now.low[i]), float(now.high[i])
                events.append(Event("moved", parameter.name, low, high, reason))
    return events
