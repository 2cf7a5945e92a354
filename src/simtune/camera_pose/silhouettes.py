"""A first guess without learning: where something moves in the film, and where the robot does.

Joints give the robot's state at each frame. With the right camera, the parts of it that are away
from their usual place lie on pixels that differ from the background, and cover all of these.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import binary_opening, distance_transform_edt

_NOISE_FACTOR = 4.0  # on the typical difference from the background: less is camera noise
_LEAST_LEVELS = 12.0  # of 256
_MOVED_PX = 3.0  # a point nearer than this to its usual place need not show
_MAX_DISTANCE_SHARE = 0.15  # of the height: cap on distances
_MIN_MOVED_POINTS = 12  # to judge a camera
_NUM_FIRST, _NUM_ELITES, _NUM_NEXT, _NUM_ROUNDS = 1000, 30, 200, 6
_SPREAD_FACTOR = 1.3  # on the spread of the best, in which new cameras are drawn
_MAX_MASK_PIXELS = 40  # for which the nearest point is searched


def moving_masks(frames: np.ndarray) -> np.ndarray:
    """(F, H, W) bool of (F, H, W, 3) frames: where they differ from the background."""
    still = np.median(frames, 0)
    differs = np.abs(frames.astype(np.float32) - still).max(-1)
    least = max(_LEAST_LEVELS, _NOISE_FACTOR * float(np.median(differs)))
    return np.stack([np.asarray(binary_opening(one > least)) for one in differs])


def likely_camera(
    project: Callable[[np.ndarray], np.ndarray],
    masks: np.ndarray,
    num_parameters: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(P,) unit coordinates of the best of some thousand cameras (cross-entropy method).

    `project(units)`: (n, P) cameras to (n, K, L, 2) pixels of many points of the robot in K frames,
    with (K, H, W) `masks` from `moving_masks`.
    """
    far = _MAX_DISTANCE_SHARE * masks.shape[1]
    away = np.stack([np.asarray(distance_transform_edt(~mask)) for mask in masks]).clip(max=far)
    shown = [_some(np.argwhere(mask)[:, ::-1], rng) for mask in masks]
    units = rng.uniform(size=(_NUM_FIRST, num_parameters))
    units[0] = 0.5
    costs = _costs(project(units), away, shown, far)
    for _ in range(_NUM_ROUNDS):
        best = np.argsort(costs)[:_NUM_ELITES]
        middle, spread = units[best].mean(0), np.cov(units[best].T)
        near = rng.multivariate_normal(middle, _SPREAD_FACTOR**2 * spread, _NUM_NEXT).clip(0, 1)
        units = np.concatenate([units[best], near])
        costs = np.concatenate([costs[best], _costs(project(near), away, shown, far)])
    return units[np.argmin(costs)]


def _costs(points: np.ndarray, away: np.ndarray, shown: list[np.ndarray], far: float) -> np.ndarray:
    """(n,) pixels: mean distance of points from masks, plus that of masks from points."""
    return np.array([_cost(projected, away, shown, far) for projected in points])


def _cost(points: np.ndarray, away: np.ndarray, shown: list[np.ndarray], far: float) -> float:
    """For (K, L, 2) points, (K, H, W) distances to masks, and pixels of each mask."""
    height, width = away.shape[1:]
    moved = np.linalg.norm(points - np.median(points, 0), axis=-1) > _MOVED_PX
    inside = (
        (points > -0.5).all(-1) & (points[..., 0] < width - 0.5) & (points[..., 1] < height - 0.5)
    )
    moved &= inside
    if moved.sum() < _MIN_MOVED_POINTS:
        return 2 * far
    frame, _ = np.nonzero(moved)
    column, row = np.rint(points[moved]).astype(int).T
    to_masks = float(away[frame, row, column].mean())
    from_masks = []
    for here, ok, pixels in zip(points, moved, shown, strict=True):
        if not len(pixels):
            continue
        if not ok.any():
            from_masks.append(far)
            continue
        distance = np.linalg.norm(pixels[:, None] - here[ok], axis=-1).min(1)
        from_masks.append(float(np.minimum(distance, far).mean()))
    return to_masks + (float(np.mean(from_masks)) if from_masks else far)


def _some(pixels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """At most `_MAX_MASK_PIXELS` of (M, 2)."""
    return pixels[rng.permutation(len(pixels))[:_MAX_MASK_PIXELS]]
