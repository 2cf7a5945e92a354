"""Gauss-Newton on pixels, with each picture's pose eliminated from the normal equations."""

import numpy as np


def without_poses(
    slopes: np.ndarray,
    of_pose: np.ndarray,
    weight: np.ndarray,
    residual: np.ndarray,
    moved: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(M, U, U) information and (M, U) slope for (U, M, pixels) slopes, with poses eliminated.

    With residuals r of the pixels, weights W, A = ∂r/∂u and P = ∂r/∂x by the poses x, which have
    `moved` (M, D) in units of their standard deviations, each picture's poses are eliminated:

        information = AᵀWA − AᵀWP (PᵀWP + 1)⁻¹ PᵀWA     slope = AᵀWr − AᵀWP (PᵀWP + 1)⁻¹ (PᵀWr + x)

    Also returns (M, D, U + 1): how x follows u, and its own step.
    """
    cross = _products(of_pose, weight, slopes)  # (M, D, U)
    of_poses = _products(of_pose, weight, of_pose) + np.eye(of_pose.shape[0])
    pull = _project(of_pose, weight, residual) + moved  # (M, D)
    follow = np.linalg.solve(of_poses, np.concatenate([cross, pull[..., None]], -1))
    information = _products(slopes, weight, slopes) - cross.swapaxes(1, 2) @ follow[..., :-1]
    slope = _project(slopes, weight, residual) - (cross.swapaxes(1, 2) @ follow[..., -1:])[..., 0]
    return information, slope, follow


def _products(a: np.ndarray, weight: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(M, A, B) for (A, M, pixels), (M, pixels), (B, M, pixels)."""
    weighted = (a * weight).swapaxes(0, 1)
    return (weighted @ b.transpose(1, 2, 0)).astype(float)


def _project(a: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(M, A) for (A, M, pixels), (M, pixels), (M, pixels)."""
    return np.einsum("amp,mp->ma", a, weight * residual).astype(float)
