"""A first guess without learning: where something moves in the film, and where the robot does.

Joints say how the robot stood at each frame. From a right camera, what of it is elsewhere than it
mostly is lies on pixels that differ from what mostly is there, and covers all of them.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import binary_opening, distance_transform_edt

_NOISE = 4.0  # times the typical difference from what stands still: less is the camera's noise
_LEAST_LEVELS = 12.0  # of 256
_ELSEWHERE_PX = 3.0  # a point that is nearer to where it mostly is need not show
_FAR = 0.15  # of the height: all that is farther away is equally wrong
_FEWEST_POINTS = 12  # that are elsewhere, for a camera to be judged
_FIRST, _KEPT, _NEXT, _ROUNDS = 1000, 30, 200, 6
_SPREAD = 1.3  # times that of the best: by how much cameras near them are tried
_PER_PIXEL = 40  # of the pixels of a mask, for which the nearest point is looked for


def moving_masks(frames: np.ndarray) -> np.ndarray:
    """(F, H, W) bool of (F, H, W, 3) frames: where something is that mostly is not."""
    still = np.median(frames, 0)
    differs = np.abs(frames.astype(np.float32) - still).max(-1)
    least = max(_LEAST_LEVELS, _NOISE * float(np.median(differs)))
    return np.stack([np.asarray(binary_opening(one > least)) for one in differs])


def likely_camera(
    project: Callable[[np.ndarray], np.ndarray],
    masks: np.ndarray,
    num_parameters: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(P,) unit coordinates of the best of some thousand cameras (cross-entropy method).

    `project(units)`: (n, P) cameras to (n, K, L, 2) pixels of many points of the robot in K frames,
    whose (K, H, W) `masks` are of `moving_masks`.
    """
    far = _FAR * masks.shape[1]
    away = np.stack([np.asarray(distance_transform_edt(~mask)) for mask in masks]).clip(max=far)
    shown = [_some(np.argwhere(mask)[:, ::-1], rng) for mask in masks]
    units = rng.uniform(size=(_FIRST, num_parameters))
    units[0] = 0.5
    costs = _costs(project(units), away, shown, far)
    for _ in range(_ROUNDS):
        best = np.argsort(costs)[:_KEPT]
        middle, spread = units[best].mean(0), np.cov(units[best].T)
        near = rng.multivariate_normal(middle, _SPREAD**2 * spread, _NEXT).clip(0, 1)
        units = np.concatenate([units[best], near])
        costs = np.concatenate([costs[best], _costs(project(near), away, shown, far)])
    return units[np.argmin(costs)]


def _costs(points: np.ndarray, away: np.ndarray, shown: list[np.ndarray], far: float) -> np.ndarray:
    """(n,) pixels: how far points are from masks, and masks from points, on average."""
    return np.array([_cost(its, away, shown, far) for its in points])


def _cost(points: np.ndarray, away: np.ndarray, shown: list[np.ndarray], far: float) -> float:
    """Of (K, L, 2) points, (K, H, W) distances to masks, and pixels of each mask."""
    height, width = away.shape[1:]
    moved = np.linalg.norm(points - np.median(points, 0), axis=-1) > _ELSEWHERE_PX
    inside = (
        (points > -0.5).all(-1) & (points[..., 0] < width - 0.5) & (points[..., 1] < height - 0.5)
    )
    moved &= inside
    if moved.sum() < _FEWEST_POINTS:
        return 2 * far
    frame, _ = np.nonzero(moved)
    column, row = np.rint(points[moved]).astype(int).T
    to_masks = float(away[frame, row, column].mean())
    from_masks = []
    for its, ok, pixels in zip(points, moved, shown, strict=True):
        if not len(pixels):
            continue
        if not ok.any():
            from_masks.append(far)
            continue
        distance = np.linalg.norm(pixels[:, None] - its[ok], axis=-1).min(1)
        from_masks.append(float(np.minimum(distance, far).mean()))
    return to_masks + (float(np.mean(from_masks)) if from_masks else far)


def _some(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """At most so many of (M, 2)."""
    return pixels[rng.permutation(len(pixels))[:_PER_PIXEL]]
