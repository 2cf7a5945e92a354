"""Before a fit: train the state estimator, and measure the detector's noise."""

from collections.abc import Sequence

import numpy as np

from simtune.budget import Budget
from simtune.fit import Photometry, Physics, ReplayFit, StateEstimator
from simtune.networks.training import TrainingClock
from simtune.trajectory import Trajectory
from simtune.tuning.learning import HeldOut
from simtune.tuning.observing import Observing, as_observed, simulator_of
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.rounds import TRAIN_ESTIMATOR
from simtune.tuning.search import SearchContext


def prepare_fit(
    context: SearchContext,
    held_out: HeldOut,
    near: HeldOut,
    real: Sequence[Trajectory],
    config: PosteriorSearchConfig,
    by_readings: ReadingsEstimate | None,
    budget: Budget,
) -> tuple[ReplayFit, Observing]:
    """A fit as large as `config` says, and how it sees real and known worlds alike.

    The state estimator is trained in held-out worlds, with gaps in readings as in `real` ones; the
    detector's noise is measured in those `near` the real one. `by_readings`: None if they are used
    in windows only, or there are none.
    """
    observe, joints = context.keypoints.observe, by_readings.joints if by_readings else None
    if not joints:
        observe = context.observation.observe_beside(observe)
    worlds, observed = held_out.worlds, as_observed(context, held_out, real)
    physics = Physics(simulator_of(context), observe, worlds.states[0, 0])
    part = budget.share(config.state_share, TRAIN_ESTIMATOR)
    clock = TrainingClock(
        config.state_updates, part, "learning to guess states", config.least_updates
    )
    estimator = StateEstimator.train(
        observed,
        physics.states(worlds.states),
        physics.space,
        physics.simulator.action_scale,
        context.seed,
        clock,
    )
    discrepancy, photometry = _appearance(context)
    replay_fit = ReplayFit(
        physics,
        estimator,
        config.fit,
        joints,
        discrepancy_std=discrepancy,
        photometry=photometry,
    )
    learnt_from = observed.evidence.at(np.arange(0))  # its scales only
    inflates_noise = by_readings is None
    return replay_fit, Observing(context, near.noise(), learnt_from, inflates_noise)


def _appearance(context: SearchContext) -> tuple[np.ndarray, Photometry]:
    """(N,) standard deviations of errors that no fit can detect, and what is known of colours."""
    space = context.simulator.space
    known = np.full(len(space), np.nan) if context.known is None else context.known
    photometry = Photometry(context.observation.image_noise, known)
    discrepancy = context.observation.discrepancy_std(space.is_appearance)
    return np.where(photometry.is_known, 0.0, discrepancy), photometry
