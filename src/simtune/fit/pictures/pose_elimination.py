"""Gauss-Newton on pixels, with each picture's pose eliminated from the normal equations."""

import numpy as np

from simtune.fit.elimination import NormalEquations, eliminate


def without_poses(
    slopes: np.ndarray,
    of_pose: np.ndarray,
    weight: np.ndarray,
    residual: np.ndarray,
    moved: np.ndarray,
) -> NormalEquations:
    """Of M pictures, each with a pose of its own, for (U, M, pixels) slopes of what they share.

    With residuals r of the pixels, weights W, A = ∂r/∂u and P = ∂r/∂x by the poses x, which have
    `moved` (M, D) in units of their standard deviations, each picture's poses are eliminated:

        information = AᵀWA − AᵀWP (PᵀWP + 1)⁻¹ PᵀWA     slope = AᵀWr − AᵀWP (PᵀWP + 1)⁻¹ (PᵀWr + x)
    """
    return eliminate(
        _products(of_pose, weight, of_pose) + np.eye(of_pose.shape[0]),
        _products(of_pose, weight, slopes),
        _project(of_pose, weight, residual) + moved,
        _products(slopes, weight, slopes),
        _project(slopes, weight, residual),
    )


def _products(a: np.ndarray, weight: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(M, A, B) for (A, M, pixels), (M, pixels), (B, M, pixels)."""
    weighted = (a * weight).swapaxes(0, 1)
    return (weighted @ b.transpose(1, 2, 0)).astype(float)


def _project(a: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(M, A) for (A, M, pixels), (M, pixels), (M, pixels)."""
    return np.einsum("amp,mp->ma", a, weight * residual).astype(float)
