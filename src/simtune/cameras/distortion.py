"""OpenCV's distortion of directions by a lens (OpenCV 4, calib3d; Brown 1966).

A `distortion` is k1, k2, p1, p2, k3. A direction is (x, y) of a point at (x, y, 1) before the lens.
"""

from collections.abc import Sequence

import numpy as np

from simtune.errors import InputError

_CONVERGENCE_TOLERANCE = 1e-9  # of a direction
_ITERATIONS = 200
_NUM_RADII = 1001  # at which a lens may not fold


def distort(distortion: Sequence[float], points: np.ndarray) -> np.ndarray:
    """(..., 2) directions (x, y) to distorted ones (x', y'), which a picture shows.

    r² = x² + y²    g = 1 + k₁ r² + k₂ r⁴ + k₃ r⁶
    x' = x g + 2 p₁ x y + p₂ (r² + 2 x²)
    y' = y g + p₁ (r² + 2 y²) + 2 p₂ x y
    """
    k1, k2, p1, p2, k3 = distortion
    x, y = points[..., 0], points[..., 1]
    squared, product = x**2 + y**2, x * y
    radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * product + p2 * (squared + 2 * x**2),
            y * radial + p1 * (squared + 2 * y**2) + 2 * p2 * product,
        ],
        -1,
    )


def undistort(distortion: Sequence[float], seen: np.ndarray) -> np.ndarray:
    """The inverse of `distort` for (..., 2) `seen`. Raises InputError if it is not found."""
    points = seen.copy()
    for _ in range(_ITERATIONS):
        off = distort(distortion, points) - seen
        if np.abs(off).max() < _CONVERGENCE_TOLERANCE:
            return points
        points = points - 0.7 * off
        if not np.abs(points).max() < 1e3:
            break
    raise _folds(distortion)


def check_spread(distortion: Sequence[float], farthest: float) -> None:
    """Raises InputError if directions farther from the axis are shown nearer to it.

    Up to the tangent `farthest` of their angle to it. A point within a fold is shown at a pixel of
    the picture, too, which belongs to another direction.
    """
    squared = np.linspace(0, farthest, _NUM_RADII) ** 2
    k1, k2, _, _, k3 = distortion
    spread = 1 + squared * (3 * k1 + squared * (5 * k2 + squared * 7 * k3))
    if not (spread > 0).all():
        raise _folds(distortion)


def _folds(distortion: Sequence[float]) -> InputError:
    return InputError(
        f"distortion {list(distortion)} folds the picture's edge back into it; "
        "calibrate the camera with more points near its corners"
    )
