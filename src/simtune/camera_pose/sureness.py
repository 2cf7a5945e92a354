"""Uncertainty of a camera that was found by edges."""

import numpy as np
from scipy.special import stdtrit

from simtune.camera_pose.found import Bend, FoundCamera
from simtune.camera_pose.tracking import Agreement, CameraFit

_CORRELATED_POINTS = 30.0  # whose errors, within and between frames, count as one
_OUTLINE_BIAS_PX = 0.3  # all outlines may be too large or too small: dark rims, compression
# Least share of outlines on edges in excess of chance: .4 to .6 for simulated cameras that were
# found, .15 to .3 for a real one, up to .06 for wrong ones.
_MIN_BEYOND_CHANCE = 0.1
_NUM_CLUSTERS = 8  # of consecutive frames, within which errors are correlated
# Of a 90 % interval, in standard deviations (Student's t)
HALF_WIDTH = float(stdtrit(_NUM_CLUSTERS - 1, 0.95))


def half_widths(found: FoundCamera) -> np.ndarray:
    """(P,) half-widths of 90 % intervals, in unit coordinates, at most the whole range.

    The whole range if outlines are on the film's edges only by chance.
    """
    if is_by_chance(found.agreement):
        return np.ones(len(found.fit.unit))
    ends = np.square(found.ends - found.fit.unit).mean(0)
    variance = np.diag(covariance(found.fit))
    if found.bend:
        variance = np.maximum(variance, _with_lens(found.bend, found.is_bent))
    return np.minimum(HALF_WIDTH * np.sqrt(variance + ends), 1.0)


def _with_lens(bend: Bend, is_bent: bool) -> np.ndarray:
    """(P,) variances where k1 is not known; not `is_bent`: it is within what is usual."""
    information = np.linalg.inv(covariance(bend.fit))
    if not is_bent:
        information[-1, -1] += (bend.k1_range / bend.k1_usual) ** 2
    return np.diag(np.linalg.inv(information))[:-1]


def is_by_chance(agreement: Agreement) -> bool:
    """Whether the camera is not the film's, judging by edges."""
    return agreement.beyond_chance < _MIN_BEYOND_CHANCE


def covariance(fit: CameraFit) -> np.ndarray:
    """(P, P), from errors of points, of consecutive frames, and common to all.

    With slopes A of N points, weights W, residuals r, G clusters of frames (Liang and Zeger 1986)
    and outlines that are all b pixels too large:

        B = (AᵀWA)⁻¹,   c · rᵀWr / tr W · B  +  B [G / (G − 1) Σ_g d_g d_gᵀ + b² v vᵀ] B
        d_g = s_g − mean of all s_g,   s_g = A_gᵀ W_g r_g,   v = AᵀW 1
    """
    weighted = fit.slopes.T * fit.weights
    information = weighted @ fit.slopes
    slack = 1e-12 * np.trace(information) * np.eye(len(information))
    inverse = np.linalg.inv(information + slack)
    clusters = fit.frames * _NUM_CLUSTERS // (fit.frames.max() + 1)
    pulls = fit.slopes * (fit.weights * fit.off_px)[:, None]
    by_cluster = np.stack([pulls[clusters == one].sum(0) for one in range(_NUM_CLUSTERS)])
    by_cluster = by_cluster - by_cluster.mean(0)
    bias = _OUTLINE_BIAS_PX * weighted.sum(1)
    common = _NUM_CLUSTERS / (_NUM_CLUSTERS - 1) * by_cluster.T @ by_cluster + np.outer(bias, bias)
    squared_px = float((fit.weights * fit.off_px**2).sum() / fit.weights.sum())
    return _CORRELATED_POINTS * squared_px * inverse + inverse @ common @ inverse
