"""Changes of positions that no sensor observes, and how far they move things in pictures."""

import numpy as np
from mujoco.batch import Batch

from simtune.fit.physics import Physics
from simtune.vision.corners import corners_of_parts

_UNSEEN_NOISE_SHARE = 0.5  # of a sensor's noise: smaller changes of a prediction are not observed
_PRIOR_STDS = 5.0  # error of a first guess considered, in units of its usual error
_SMALL_CHANGE_SHARE = 1 / 32  # small enough for an angle
_ROUNDING = 1e-9  # m, or of a direction
_MIN_SHIFT_PX = 0.5  # that a picture shows well enough to look for the best place


def unobserved(physics: Physics, prior_std: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(D, 2 nv) changes of position, as large as the prior allows, that no sensor observes.

    For example with a camera that follows the robot: only the ground's texture shows its travel,
    and only contacts determine its height.
    """
    space, parameters = physics.space, physics.parameters
    changes = np.diag(np.minimum(_PRIOR_STDS * prior_std, space.largest_change))[: space.nv]
    changes = changes[prior_std[: space.nv] > 0]
    moved = space.move(physics.some_state, np.vstack([0 * changes[:1], changes]))
    predicted = physics.predict(moved, parameters.to_unit(parameters.nominal))
    difference = np.abs(predicted[1:] - predicted[:1]) / scale
    return changes[difference.max(1, initial=0) < _UNSEEN_NOISE_SHARE]


def shown_in_pictures(
    physics: Physics, full_states: np.ndarray, parameters: np.ndarray, changes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Those of (D, 2 nv) changes that move something by half a pixel, and by how many each does.

    In the picture where it is most, of (M, S) states. Infinitely many if a camera moves: a floor's
    texture is passing by, and may be fine.
    """
    if not len(changes):
        return changes, np.zeros(0)
    simulator, space = physics.simulator, physics.space
    corners = corners_of_parts(simulator.model, simulator.views, simulator.image_size)

    def see(batch: Batch) -> np.ndarray:
        cameras = batch.cam_xpos[:, corners.cameras], batch.cam_xmat[:, corners.cameras]
        poses = [pose.reshape(batch.nsim, -1) for pose in cameras]
        return np.concatenate([corners.observe(batch), *poses], 1)

    states, num = physics.states(full_states), len(full_states)
    steps = np.vstack([0 * changes[:1], _SMALL_CHANGE_SHARE * changes])[:, None]
    moved = space.move(states, np.repeat(steps, num, 1)).reshape(-1, states.shape[1])
    seen = physics.observing(see).predict(moved, physics.parameters.to_unit(parameters))
    seen = seen.reshape(len(steps), num, -1)
    away = np.abs(seen[1:] - seen[:1]).max(1, initial=0) / _SMALL_CHANGE_SHARE  # (D, ·)
    pixels, camera = np.split(away, [2 * len(corners)], 1)
    shifts = np.where((camera > _ROUNDING).any(1), np.inf, pixels.max(1, initial=0))
    shown = shifts >= _MIN_SHIFT_PX
    return changes[shown], shifts[shown]
