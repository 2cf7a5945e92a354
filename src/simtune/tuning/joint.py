"""The joint posterior: each parameter's survival curve, and the correlations of their errors.

A Gaussian copula (Sklar 1959; Nelsen 2006, An Introduction to Copulas): with Φ the normal
distribution function, S_i the survival curve of parameter i, R the correlation of the fit's errors,

    z ~ N(0, R)        ξ_i = S_i⁻¹(1 − Φ(z_i))        i = 1 … N

So each ξ_i has the distribution of its curve for any R, and the rank correlation of two is
6/π · asin(R_ij / 2). A parameter's coordinate grows with its value on either scale, so signs stay.

Curves are interpolated along each parameter's own scale. Probability beyond a curve's ends is
spread up to the bound; if much is beyond both ends, the parameter is uniform within its bounds. A
search without curves (`--search paper`, a fixed range) only has its range: parameters are then
independent and uniform within it, as its worlds are drawn.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from simtune.normal import STDS_90
from simtune.parameters import ParameterSpace
from simtune.tuning.estimate import Estimate

NUM_DRAWS = 4000  # kept by a run: ends of 90 % intervals to a thirtieth of a standard deviation
_TELLS_NOTHING = 0.25  # probability beyond both ends, from which a curve is ignored
_POINTS = 65  # of a uniform distribution, which may be curved on another scale


@dataclass(frozen=True)
class Joint:
    """Posterior of N parameters, in unit coordinates."""

    space: ParameterSpace
    # for each: (C,) cumulative probability, rising from 0 to 1, and (C,) coordinates
    marginals: tuple[tuple[np.ndarray, np.ndarray], ...]
    correlation: np.ndarray  # (N, N)

    @classmethod
    def of(cls, estimate: Estimate, space: ParameterSpace) -> "Joint":
        marginals = tuple(_marginal(estimate, space, i) for i in range(len(space)))
        known = estimate.correlation
        return cls(space, marginals, np.eye(len(space)) if known is None else known)

    def quantile(self, share: np.ndarray) -> np.ndarray:
        """(..., N) coordinates below which each parameter is with probability `share` (..., N)."""
        columns = [np.interp(share[..., i], *m) for i, m in enumerate(self.marginals)]
        return np.stack(columns, -1)

    def draw(self, num: int, rng: np.random.Generator) -> np.ndarray:
        """(num, N) parameters within their bounds."""
        values, vectors = np.linalg.eigh(self.correlation)
        # Rounding may make the smallest eigenvalues of a singular matrix negative.
        root = vectors * np.sqrt(values.clip(0))
        normal = rng.normal(size=(num, len(self.space))) @ root.T
        return self.space.from_unit(self.quantile(ndtr(normal)))

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
        values = np.linspace(estimate.low[i], estimate.high[i], _POINTS)
        return np.linspace(0, 1, _POINTS), _to_unit(space, i, values)
    candidates, prob_higher = estimate.curves[space.names[i]]
    below = 1 - np.minimum.accumulate(prob_higher)
    if min(below[0], 1 - below[-1]) > _TELLS_NOTHING:
        return np.array([0.0, 1.0]), np.array([0.0, 1.0])
    unit = np.clip(_to_unit(space, i, candidates), 0, 1)
    return np.concatenate([[0], below, [1]]), np.concatenate([[0], unit, [1]])


def _to_unit(space: ParameterSpace, i: int, values: np.ndarray) -> np.ndarray:
    """(C,) coordinates of one parameter's values."""
    return space.to_unit(np.repeat(values[:, None], len(space), 1))[:, i]
