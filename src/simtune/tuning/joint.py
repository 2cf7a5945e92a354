"""The joint posterior: each parameter's survival curve, and the correlations of their errors.

A Gaussian copula (Sklar 1959; Nelsen 2006, An Introduction to Copulas): with Φ the normal
distribution function, S_i the survival curve of parameter i, R the correlation of the fit's errors,

    z ~ N(0, R)        ξ_i = S_i⁻¹(1 − Φ(z_i))        i = 1 … N

So each ξ_i has the distribution of its curve for any R, and the rank correlation of two is
6/π · asin(R_ij / 2). A parameter's coordinate grows with its value on either scale, so signs stay.

Curves are interpolated along each parameter's own scale. Probability beyond a curve's ends is
spread up to the bound. If some is beyond both ends, the curve is taken for a normal one,
ξ_i = m_i + s_i z_i, within the bounds: two masses of which only the ratio is known may be anywhere
in theirs, but together. If it is flat, the parameter is uniform. A search without curves
(`--search paper`, a fixed range) only has its range: parameters are then independent and uniform
within it, as its worlds are drawn.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from simtune.normal import STDS_90
from simtune.parameters import ParameterSpace
from simtune.tuning.estimate import Estimate
from simtune.tuning.truncated_normal import draw_beside, draw_in_box

NUM_DRAWS = 4000  # kept by a run: ends of 90 % intervals to a thirtieth of a standard deviation
_BEYOND_PROBABILITY = 0.05  # past each end, from which a curve is taken for a normal one
_FLAT_STDS = 100.0  # of such a curve, from which it tells nothing
_NEGLIGIBLE_PROBABILITY = 1e-3  # that nothing is concluded from
_DRAWS_PER_BLOCK = 1000
_UNIFORM_POINTS = 65  # of a distribution that may be curved on another scale


@dataclass(frozen=True)
class Joint:
    """Posterior of N parameters, in unit coordinates."""

    space: ParameterSpace
    # for each: (C,) cumulative probability, rising from 0 to 1, and (C,) coordinates
    marginals: tuple[tuple[np.ndarray, np.ndarray], ...]
    correlation: np.ndarray  # (N, N)
    # (2, N) mean and standard deviation of those that are normal within their bounds, else NaN
    normal: np.ndarray

    @classmethod
    def of(cls, estimate: Estimate, space: ParameterSpace) -> "Joint":
        marginals = [_marginal(estimate, space, i) for i in range(len(space))]
        normal, known = np.full((2, len(space)), np.nan), estimate.correlation
        for i, (below, unit) in enumerate(marginals):
            if min(below[1], 1 - below[-2]) <= _BEYOND_PROBABILITY:
                continue
            mean, std = normal[:, i] = _normal(below[1:-1], unit[1:-1])
            unit = np.linspace(0, 1, _UNIFORM_POINTS)
            below = ndtr((unit - mean) / std) if np.isfinite(std) else unit
            marginals[i] = (below - below[0]) / (below[-1] - below[0]), unit
        normal[:, ~np.isfinite(normal[1])] = np.nan
        correlation = np.eye(len(space)) if known is None else known
        return cls(space, tuple(marginals), correlation, normal)

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """(..., N) coordinates below which each parameter is with probability `share` (..., N)."""
        columns = [np.interp(share[..., i], *m) for i, m in enumerate(self.marginals)]
        return np.stack(columns, -1)

    def draw(self, num: int, rng: np.random.Generator) -> np.ndarray:
        """(num, N) parameters within their bounds; fewer and more begin alike."""
        blocks = [self._draw_block(rng) for _ in range(-(-num // _DRAWS_PER_BLOCK))]
        return self.space.from_unit(np.concatenate(blocks)[:num])

    def _draw_block(self, rng: np.random.Generator) -> np.ndarray:
        """(_DRAWS_PER_BLOCK, N) unit coordinates."""
        is_normal = np.isfinite(self.normal[0])
        mean, std = self.normal[:, is_normal]
        among = self.correlation[np.ix_(is_normal, is_normal)] * np.outer(std, std)
        in_box = draw_in_box(mean, among, _DRAWS_PER_BLOCK, rng)
        drawn = draw_beside((in_box - mean) / std, is_normal, self.correlation, rng)
        unit = self.quantile(ndtr(drawn))
        unit[:, is_normal] = in_box
        return unit

    def mean_and_covariance(self) -> tuple[np.ndarray, np.ndarray]:
        """(N,) medians, (N, N) covariance: of normal errors with the same central 90 %.

        A sample covariance would be dominated by rare draws far away.
        """
        ones = np.ones(len(self.space))
        low, middle, high = (self.quantile(share * ones) for share in (0.05, 0.5, 0.95))
        std = (high - low) / (2 * STDS_90)
        return middle, self.correlation * np.outer(std, std)


def _marginal(estimate: Estimate, space: ParameterSpace, i: int) -> tuple[np.ndarray, np.ndarray]:
    if space.names[i] not in estimate.curves:
        values = np.linspace(estimate.low[i], estimate.high[i], _UNIFORM_POINTS)
        return np.linspace(0, 1, _UNIFORM_POINTS), _to_unit(space, i, values)
    candidates, prob_higher = estimate.curves[space.names[i]]
    below = 1 - np.minimum.accumulate(prob_higher)
    unit = np.clip(_to_unit(space, i, candidates), 0, 1)
    return np.concatenate([[0], below, [1]]), np.concatenate([[0], unit, [1]])


def _normal(below: np.ndarray, unit: np.ndarray) -> tuple[float, float]:
    """Mean, within the bounds, and standard deviation of a normal curve; infinite if it is flat."""
    known = (below > _NEGLIGIBLE_PROBABILITY) & (below < 1 - _NEGLIGIBLE_PROBABILITY)
    if known.sum() < 2 or np.ptp(unit[known]) <= 0:
        return 0.5, np.inf
    slope, at_0 = np.polyfit(unit[known], ndtri(below[known]), 1)
    if slope <= 1 / _FLAT_STDS:
        return 0.5, np.inf
    return float(np.clip(-at_0 / slope, 0, 1)), float(1 / slope)


def _to_unit(space: ParameterSpace, i: int, values: np.ndarray) -> np.ndarray:
    """(C,) coordinates of one parameter's values."""
    return space.to_unit(np.repeat(values[:, None], len(space), 1))[:, i]
