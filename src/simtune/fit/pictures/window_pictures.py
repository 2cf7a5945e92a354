"""Fits colours and light to pictures from the windows of a motion fit."""

import numpy as np

from simtune.fit.fit_setup import FitSetup
from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.pictures.picture_fit import PictureFit, Pictures, fit_pictures
from simtune.fit.pictures.poses import align_to_images, uncertain_poses
from simtune.fit.pictures.response import Photometry

# Of all frames, only those that the motion fits best: a thin leg that is a pixel off takes the
# ground's colour. Choosing by windows was not enough: at 2 px, colours were 5 % too dark.
_GOOD_FRAMES = 0.15, 0.6  # bounds of their share: the least that gives enough pictures
_UNSEEN = 0.5  # of a sensor's noise: smaller changes of a prediction are not observed
_PRIOR_STDS = 5.0  # error of a first guess considered, in units of its usual error
_MOTION_STDS = 3.0  # errors of a motion's fit considered, in standard deviations


def fit_window_pictures(
    setup: FitSetup,
    motion: ShootingFit,
    observed: Observed,
    parameters: np.ndarray,
    shown: np.ndarray,
    photometry: Photometry,
) -> PictureFit:
    """Fit parameters `shown`, (V,) indices, to pictures of the windows of `motion`.

    `parameters`: (N,) initial.
    """
    physics, prior_std = setup.physics, setup.prior_std
    parameters = np.where(photometry.is_known, photometry.known, parameters)
    chosen, step = well_fitted(physics, motion, observed, parameters, setup.config.num_pictures)
    places = zip(motion.episode[chosen], motion.step[chosen] + step, strict=True)
    frames = np.stack([observed.frames[episode][t] for episode, t in places])
    full_states, scale = motion.full_states[chosen, step], observed.evidence.scale
    unseen, by_motion = _unobserved(physics, prior_std, scale), _MOTION_STDS * motion.state_std
    largest = np.where(unseen.any(0), np.minimum(by_motion, prior_std), prior_std)
    untold = unseen[(unseen * (largest == prior_std)).any(1)]
    # Where there are several, the first is searched again once the others are found.
    for tangent in np.tile(untold, (min(2, len(untold)), 1)):
        full_states, left_open = align_to_images(
            physics.render, frames, full_states, parameters, physics.space, tangent
        )
        largest = np.where(tangent != 0, np.minimum(left_open, prior_std), largest)
    num_shown = len(observed.evidence.parts[0].scale)
    poses = uncertain_poses(physics, full_states, parameters, scale, num_shown, largest)
    noise = photometry.camera_noise
    pictures = Pictures(frames=frames, full_states=full_states, poses=poses, camera_noise=noise)
    is_known = photometry.is_known[shown]
    return fit_pictures(physics.simulator, pictures, parameters, shown, is_known)


def well_fitted(
    physics: Physics, motion: ShootingFit, observed: Observed, parameters: np.ndarray, at_most: int
) -> tuple[np.ndarray, np.ndarray]:
    """(M,) windows and (M,) steps in them of `at_most` well-fitted frames, spread over all."""
    num, length = motion.full_states.shape[:2]
    states = physics.states(motion.full_states).reshape(num * length, -1)
    predicted = physics.predict(states, physics.parameters.to_unit(parameters))
    frames = motion.step[:, None] + np.arange(length)
    single = observed.evidence.at((motion.episode[:, None, None], frames[..., None]))
    likelihood = single.log_likelihood(predicted.reshape(num, length, 1, -1))  # (W, K)
    # Without the windows' ends, where states are less certain.
    margin = length // 4
    likelihood = likelihood[:, margin : length - margin]
    share = np.clip(at_most / likelihood.size, *_GOOD_FRAMES)
    good = np.argwhere(likelihood >= np.quantile(likelihood, 1 - share))
    at = np.unique(np.linspace(0, len(good) - 1, at_most).round()).astype(int)
    window, step = good[at].T
    return window, step + margin


def _unobserved(physics: Physics, prior_std: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(D, 2 nv) changes of position, as large as the prior allows, that no sensor observes.

    For example with a camera that follows the robot: only the ground's texture shows its travel,
    and only contacts determine its height.
    """
    space, parameters = physics.space, physics.parameters
    changes = np.diag(_PRIOR_STDS * prior_std)[: space.nv]
    changes = changes[prior_std[: space.nv] > 0]
    moved = space.move(physics.some_state, np.vstack([0 * changes[:1], changes]))
    predicted = physics.predict(moved, parameters.to_unit(parameters.nominal))
    difference = np.abs(predicted[1:] - predicted[:1]) / scale
    return changes[difference.max(1, initial=0) < _UNSEEN]
