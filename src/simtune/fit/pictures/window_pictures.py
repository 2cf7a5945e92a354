"""Fits colours and light to pictures from the windows of a motion fit."""

import numpy as np

from simtune.fit.fit_setup import FitSetup
from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.pictures.picture_fit import PictureFit, Pictures, fit_pictures
from simtune.fit.pictures.poses import align_to_images, uncertain_poses
from simtune.fit.pictures.response import Photometry
from simtune.fit.pictures.unseen import shown_in_pictures, unobserved

# Of all frames, only those that the motion fits best: a thin leg that is a pixel off takes the
# ground's colour. Choosing by windows was not enough: at 2 px, colours were 5 % too dark.
_GOOD_FRAME_SHARES = 0.15, 0.6  # bounds: the least that gives enough pictures
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
    unseen, by_motion = unobserved(physics, prior_std, scale), _MOTION_STDS * motion.state_std
    largest = np.where(unseen.any(0), np.minimum(by_motion, prior_std), prior_std)
    untold = unseen[(unseen * (largest == prior_std)).any(1)]
    untold, shifts = shown_in_pictures(physics, full_states, parameters, untold)
    # Where there are several, each is searched again once the others are found.
    for tangent, shift in [*zip(untold, shifts, strict=True)] * min(2, len(untold)):
        full_states, left_open = align_to_images(
            physics.render, frames, full_states, parameters, physics.space, tangent, shift
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
    share = np.clip(at_most / likelihood.size, *_GOOD_FRAME_SHARES)
    good = np.argwhere(likelihood >= np.quantile(likelihood, 1 - share))
    at = np.unique(np.linspace(0, len(good) - 1, at_most).round()).astype(int)
    window, step = good[at].T
    return window, step + margin
