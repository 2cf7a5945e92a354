"""Draws of correlated normal numbers, some of which lie within bounds."""

import numpy as np
from scipy.special import ndtr, ndtri

_SWEEPS = 30


def draw_in_box(
    mean: np.ndarray, covariance: np.ndarray, num: int, rng: np.random.Generator
) -> np.ndarray:
    """(num, W) of N(mean, covariance) where all are in [0, 1], as (W,) `mean` is.

    Gibbs sampling along the eigenvectors of the covariance (Geweke 1991): x = m + V Λ^½ y, with
    independent y but for the box. So each y is drawn in turn from a normal distribution between
    what the others leave. Along x itself it would hardly move where two are nearly one.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(values.clip(0))  # rounding may make the smallest ones negative
    y, x = np.zeros((num, len(mean))), np.tile(mean, (num, 1))
    for _ in range(_SWEEPS):
        for k, along in enumerate(root.T):
            moves = along != 0
            others = x[:, moves] - y[:, k, None] * along[moves]
            ends = [(end - others) / along[moves] for end in (0.0, 1.0)]
            least = np.minimum(*ends).max(1, initial=-np.inf)
            most = np.maximum(np.maximum(*ends).min(1, initial=np.inf), least)
            share = ndtr(least) + rng.random(num) * (ndtr(most) - ndtr(least))
            new = np.clip(ndtri(share), least, most)
            x += np.outer(new - y[:, k], along)
            y[:, k] = new
    return x.clip(0, 1)


def draw_beside(
    known: np.ndarray, is_known: np.ndarray, correlation: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(num, N) of N(0, R) of which (num, W) are `known`, those that (N,) bool says."""
    of_known, mixed = correlation[np.ix_(is_known, is_known)], correlation[~is_known][:, is_known]
    weights = mixed @ np.linalg.pinv(of_known)
    left = correlation[np.ix_(~is_known, ~is_known)] - weights @ mixed.T
    values, vectors = np.linalg.eigh(left)
    drawn = np.empty((len(known), len(correlation)))
    drawn[:, is_known] = known
    own = rng.normal(size=(len(known), len(left))) @ (vectors * np.sqrt(values.clip(0))).T
    drawn[:, ~is_known] = known @ weights.T + own
    return drawn
