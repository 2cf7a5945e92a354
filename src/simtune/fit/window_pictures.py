"""Colours and light by pictures of windows of a motion, where the fit of that puts things."""

import numpy as np

from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.pictures import PictureFit, fit_pictures
from simtune.fit.poses import align_to_images, uncertain_poses
from simtune.fit.shooting import ShootingFit

_NUM_PICTURES = 40
_GOOD_WINDOWS = 0.6  # of all, whose pictures are looked at
_UNSEEN = 0.5  # of a sensor's noise: what changes a prediction by less is not observed
_PRIOR_STDS = 3.0  # as far as a first guess may be off, in terms of its usual error


def fit_window_pictures(
    physics: Physics,
    prior_std: np.ndarray,
    motion: ShootingFit,
    observed: Observed,
    parameters: np.ndarray,
    fitted: np.ndarray,
) -> PictureFit:
    """Fit parameters `fitted`, (V,) indices, to pictures of the windows of `motion`.

    `prior_std`: (2 nv,) usual errors of a first guess at a state; `parameters`: (N,) to start from.
    """
    chosen, step = _well_fitted(motion)
    places = zip(motion.episode[chosen], motion.step[chosen] + step, strict=True)
    frames = np.stack([observed.frames[episode][t] for episode, t in places])
    full_states, scale = motion.full_states[chosen, step], observed.evidence.scale
    for tangent in _unobserved(physics, prior_std, scale):
        full_states = align_to_images(
            physics.simulator, frames, full_states, parameters, physics.space, tangent
        )
    poses = uncertain_poses(physics, full_states, parameters, scale, prior_std)
    return fit_pictures(physics.simulator, frames, full_states, parameters, fitted, poses)


def _well_fitted(motion: ShootingFit) -> tuple[np.ndarray, np.ndarray]:
    """(M,) windows that fit well and (M,) steps in them, spread over all of them."""
    good = np.flatnonzero(motion.misfit <= np.quantile(motion.misfit, _GOOD_WINDOWS))
    length = motion.full_states.shape[1] - 1
    # Not from the windows' ends, where less is known of the states.
    within = np.arange(-(-length // 4), length - length // 4 + 1)
    at = np.unique(np.linspace(0, len(good) * len(within) - 1, _NUM_PICTURES).round()).astype(int)
    return good[at // len(within)], within[at % len(within)]


def _unobserved(physics: Physics, prior_std: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(D, 2 nv) changes of position, as large as is unknown, that no sensor notices.

    A camera that follows the robot, say: how far it went shows in the ground's texture only.
    """
    space, parameters = physics.space, physics.parameters
    changes = np.diag(_PRIOR_STDS * prior_std)[: space.nv]
    moved = space.move(physics.some_state, np.vstack([0 * changes[:1], changes]))
    predicted = physics.predict(moved, parameters.to_unit(parameters.nominal))
    difference = np.abs(predicted[1:] - predicted[:1]) / scale
    return changes[difference.max(1, initial=0) < _UNSEEN]
