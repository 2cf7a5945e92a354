"""Ξ: the distribution that simulated worlds draw their parameters from (Sec. III)."""

from dataclasses import dataclass, replace

import numpy as np

from simtune.parameters import ParameterSpace

_ZERO_RANGE_SHARE = 0.1
_FIRST_FACTOR = 3.0  # up and down from the start


def size_of(space: ParameterSpace, mean: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """(N,) what the paper's ranges and steps are shares of: |mean|, since its parameters are > 0.

    Of a parameter that may be negative, such as an angle, it is half the distance between its
    bounds. Of one that is 0, such as a delay, it is a tenth of that distance, and no less once it
    has moved, if it was 0 at the `start` (N,) of a search (by default the mean).
    """
    whole = space.high - space.low
    is_zero = (space.low == 0) & ((mean if start is None else start) == 0)
    size = np.where(space.low < 0, whole / 2, np.abs(mean))
    return np.where(is_zero, np.maximum(size, _ZERO_RANGE_SHARE * whole), size)


@dataclass(frozen=True)
class Distribution:
    """Independent uniforms in [low, high], with the present estimate `mean` inside.

    Along each parameter's own scale (log or linear), or linear for all, as in the paper.
    """

    space: ParameterSpace
    mean: np.ndarray  # (N,) ξ_mean
    low: np.ndarray  # (N,)
    high: np.ndarray  # (N,)
    on_own_scale: bool = True
    start: np.ndarray | None = None  # (N,) of the search, see `size_of`; None: `mean`

    @classmethod
    def proportional(
        cls,
        space: ParameterSpace,
        mean: np.ndarray,
        range_: float,
        start: np.ndarray | None = None,
    ) -> "Distribution":
        """The paper's: U[mean·(1 − range), mean·(1 + range)], clipped to the bounds.

        Of parameters that are not above 0, the range is a share of what `size_of` says.
        """
        size = size_of(space, mean, start)
        ends = space.clip(mean - range_ * size), space.clip(mean + range_ * size)
        return cls(space, mean, *ends, on_own_scale=False, start=start)

    def around(self, mean: np.ndarray, range_: float) -> "Distribution":
        """`proportional` around another mean of the same search."""
        return Distribution.proportional(self.space, mean, range_, self.start)

    @classmethod
    def first(cls, space: ParameterSpace, mean: np.ndarray) -> "Distribution":
        """The first range of a search: a factor up and down; all of a linear scale's bounds."""
        low = np.where(space.is_log, mean / _FIRST_FACTOR, space.low)
        high = np.where(space.is_log, mean * _FIRST_FACTOR, space.high)
        return cls(space, mean, space.clip(low), space.clip(high))

    def with_interval(self, mean: np.ndarray, low: np.ndarray, high: np.ndarray) -> "Distribution":
        """The same kind of distribution with another interval."""
        return replace(self, mean=mean, low=self.space.clip(low), high=self.space.clip(high))

    @property
    def unit_width(self) -> np.ndarray:
        """(N,) of the interval, in unit coordinates."""
        return self.space.to_unit(self.high) - self.space.to_unit(self.low)

    def state(self) -> dict[str, list[float]]:
        """Input of `with_state`; JSON."""
        return {key: getattr(self, key).tolist() for key in ("mean", "low", "high")}

    def with_state(self, state: dict[str, list[float]]) -> "Distribution":
        """The same kind of distribution with the interval of a `state`."""
        return self.with_interval(**{key: np.array(values) for key, values in state.items()})

    def sample(self, num: int, rng: np.random.Generator) -> np.ndarray:
        """(num, N) parameters."""
        uniform = rng.uniform(size=(num, len(self.space)))
        return self.from_range_unit(uniform)

    def to_range_unit(self, parameters: np.ndarray) -> np.ndarray:
        """(..., N) parameters to coordinates that are 0 at `low` and 1 at `high`."""
        low, high = self._spread(self.low), self._spread(self.high)
        return (self._spread(parameters) - low) / (high - low)

    def from_range_unit(self, range_unit: np.ndarray) -> np.ndarray:
        """The inverse of `to_range_unit`; on their own scale within the bounds in any case."""
        low, high = self._spread(self.low), self._spread(self.high)
        spread = low + range_unit * (high - low)
        return self.space.from_unit(spread) if self.on_own_scale else spread

    def _spread(self, parameters: np.ndarray) -> np.ndarray:
        return self.space.to_unit(parameters) if self.on_own_scale else np.asarray(parameters)
