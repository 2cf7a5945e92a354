"""Before motion is fitted: when actions took effect, what encoders show too much, first states."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simtune.fit.fit_setup import FitSetup
from simtune.fit.motion.offsets import has_unknown_offsets, loosened, without_offsets
from simtune.fit.motion.particles import Particles
from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.observed import Observed
from simtune.fit.readings.joint_motion import JointMotion, keep_moved_keypoints, without_readings
from simtune.fit.result import PointEstimate

_PARTICLE_STD = (0.02, 0.1)  # bounds of the particles' parameter spread, in unit coordinates
_QUICK_STAGES = Stage(4, 3, 3.0), Stage(12, 4)
_QUICK_WINDOWS = (12, 30)  # bounds
_LOOK_EVERY_STEPS = 8  # for keypoints that something unknown moves
# By how much −log likelihood per observation must be lower, and by how many standard errors of that
_MIN_GAIN, _MIN_GAIN_STDS = 0.05, 1.5


class FollowedAll(NamedTuple):
    """By the particle filter, of all episodes."""

    states: np.ndarray  # (E, T + 1, nq + nv)
    start: PointEstimate  # of the fit


class LinedUp(NamedTuple):
    """Episodes with actions shifted to when they take effect, and readings without offsets."""

    observed: Observed
    latency_steps: int  # delay of the actions
    offsets: np.ndarray  # (D,) of all encoders; (0,) if none is unknown
    states: np.ndarray  # as in `FollowedAll`
    start: PointEstimate


def line_up(
    setup: FitSetup,
    observed: Observed,
    fitted: slice,
    start: PointEstimate,
    latencies: Sequence[int],
) -> LinedUp:
    """Find the latency of actions, then the encoders' offsets, for which it must be known.

    If the readings give the robot's motion, the latency is known: it is the first of `latencies`.
    """
    if setup.joints is not None:
        return _by_readings(setup, setup.joints, observed, fitted, start, latencies[0])
    latency_steps, followed = latencies[0], None
    if len(latencies) > 1:
        late = observed.delayed(latency_steps)
        followed = _follow(setup, late, setup.estimator(late), fitted, start)
        latency_steps = _find_latency(setup, observed, fitted, followed, latencies)
    observed, offsets = _find_offsets(setup, observed.delayed(latency_steps), start.parameters)
    if followed is None or latency_steps != latencies[0] or len(offsets):
        followed = _follow(setup, observed, setup.estimator(observed), fitted, start)
    return LinedUp(observed, latency_steps, offsets, *followed)


def _by_readings(
    setup: FitSetup,
    joints: JointMotion,
    observed: Observed,
    fitted: slice,
    start: PointEstimate,
    latency_steps: int,
) -> LinedUp:
    """The robot's motion is that of the readings; pictures show the rest."""
    observed = observed.delayed(latency_steps)
    states, offsets = joints.find(observed, setup.estimator(observed), start.parameters)
    # A thing may come into view late
    some = states[:, ::_LOOK_EVERY_STEPS].reshape(-1, states.shape[-1])
    observed = keep_moved_keypoints(
        without_readings(observed),
        setup.physics,
        some,
        setup.prior_std,
        setup.space.to_unit(start.parameters),
        setup.moving,
    )
    followed = _follow(setup, observed, states, fitted, start)
    return LinedUp(observed, latency_steps, offsets, *followed)


def _follow(
    setup: FitSetup, observed: Observed, guessed: np.ndarray, fitted: slice, start: PointEstimate
) -> FollowedAll:
    """Follow all episodes from (E, T + 1, nq + nv) first guesses at states.

    The parameters are estimated from the `fitted` episodes.
    """
    moving = setup.moving
    particles = Particles(setup.physics, setup.prior_std, moving, setup.config.num_particles)
    unit, std = setup.space.to_unit(start.parameters), start.std.copy()
    followed = particles.follow(observed, guessed, unit, np.clip(start.std, *_PARTICLE_STD))
    estimates = followed.unit[fitted]
    unit[moving] = np.median(estimates, 0)
    std[moving] = std_of_mean(estimates, start.std[moving])
    return FollowedAll(followed.states, PointEstimate(setup.space.from_unit(unit), std))


def std_of_mean(estimates: np.ndarray, before: np.ndarray) -> np.ndarray:
    """(P,) of the mean of (E, P) estimates, one an episode, with (P,) std known `before`.

    Few episodes may agree by chance, so what was known before counts like one degree of freedom:
    √((σ² + Σ_e (u_e − ū)²) / E) / √E. Fits that begin close together on the wrong side may both
    end there, and look sure: with it, six of rope_peg's refits erred by .8 of their claims (rms),
    without by 1.5.
    """
    scatter = np.square(estimates - estimates.mean(0)).sum(0)
    return np.sqrt(np.square(before) + scatter) / len(estimates)


def _find_latency(
    setup: FitSetup,
    observed: Observed,
    fitted: slice,
    followed: FollowedAll,
    latencies: Sequence[int],
) -> int:
    """The latency of the actions, in steps, with which the motion fits clearly best.

    Starts from the states `followed` with the first latency: from the estimator's, which are
    less accurate, windows tell little.
    """
    states, parameters = followed.states[fitted], followed.start.parameters
    late = [observed.delayed(steps).episodes(fitted) for steps in latencies]
    misfits = [fit_quickly(setup, candidate, states, parameters).misfit for candidate in late]
    return latencies[clearly_best(np.array(misfits))]


def _find_offsets(
    setup: FitSetup, observed: Observed, parameters: np.ndarray
) -> tuple[Observed, np.ndarray]:
    """Observations without encoder offsets, and these, (D,) of all joints, from pictures."""
    if not has_unknown_offsets(observed):
        return observed, np.zeros(0)
    loose = loosened(observed)
    fit = fit_quickly(setup, loose, setup.estimator(loose), parameters)
    unit = setup.space.to_unit(parameters)
    unit[setup.moving] = fit.unit
    return without_offsets(observed, setup.physics, fit, setup.space.from_unit(unit))


def fit_quickly(
    setup: FitSetup, observed: Observed, states: np.ndarray, parameters: np.ndarray
) -> ShootingFit:
    """Fit few short windows from first guesses at the (E, T + 1, nq + nv) states."""
    num_windows = int(np.clip(setup.config.shooting.num_windows, *_QUICK_WINDOWS))
    quick = ShootingConfig(stages=_QUICK_STAGES, num_windows=num_windows)
    return setup.shooting(setup.moving, quick).fit(observed, states, parameters)


def clearly_best(misfits: np.ndarray) -> int:
    """The row of (hypotheses, W) misfits that is clearly lowest; 0, the usual one, if none is.

    Misfits vary far more between windows than between hypotheses, so the differences in the same
    windows are compared (paired), not two medians.
    """
    worse = misfits - misfits[0]
    at_best = worse.mean(1) + _MIN_GAIN_STDS * worse.std(1) / np.sqrt(worse.shape[1])
    best = int(np.argmin(at_best))
    return best if at_best[best] < -_MIN_GAIN else 0
