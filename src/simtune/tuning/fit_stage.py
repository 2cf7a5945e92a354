"""Last stage of a round: fit the simulator to the observations, and judge the fit by refits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.budget import Budget
from simtune.fit import (
    FitResult,
    Observed,
    Photometry,
    Physics,
    PointEstimate,
    Refits,
    ReplayFit,
    StateEstimator,
    run_bootstrap,
)
from simtune.networks.training import TrainingClock
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.trajectory import Trajectory
from simtune.tuning.detected import HeldOut
from simtune.tuning.known_worlds import KnownWorlds
from simtune.tuning.observing import Observing, as_observed, simulator_of
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.refit_plan import RefitPlan
from simtune.tuning.rounds import TRAIN_ESTIMATOR
from simtune.tuning.search import SearchContext


@dataclass(frozen=True)
class FitStage:
    """A fit with the detector's noise and a state estimator; it treats all worlds alike."""

    context: SearchContext
    model: PosteriorSearchParamModel
    replay_fit: ReplayFit
    observing: Observing  # what is fitted, real and known

    @classmethod
    def prepare(
        cls,
        context: SearchContext,
        model: PosteriorSearchParamModel,
        held_out: HeldOut,
        near: HeldOut,
        real: Sequence[Trajectory],
        config: PosteriorSearchConfig,
        budget: Budget,
        by_readings: ReadingsEstimate | None = None,
    ) -> "FitStage":
        """Train the state estimator in held-out worlds, with gaps in readings as in `real` ones.

        The detector's noise is measured in those `near` the real one. `by_readings`: None if they
        are used in windows only, or there are none.
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
        replay_fit = ReplayFit(physics, estimator, discrepancy, config.fit, photometry, joints)
        learnt_from = observed.evidence.at(np.arange(0))  # its scales only
        observing = Observing(
            context, near.noise(), learnt_from, inflates_noise=by_readings is None
        )
        return cls(context, model, replay_fit, observing)

    @property
    def reading_labels(self) -> tuple[str, ...]:
        """Labels of the fits' offsets."""
        return self.context.observation.reading_labels

    def sized(self, num_steps: int, seconds: float, at_most_s: float) -> "FitStage":
        """The same, with fits that take about `seconds`, for real episodes of `num_steps` in all.

        See `fit_to_budget`.
        """
        return replace(self, replay_fit=self.replay_fit.sized(num_steps, seconds, at_most_s))

    def least(self) -> "FitStage":
        """The same, with fits as small as they may be."""
        return replace(self, replay_fit=self.replay_fit.least())

    @property
    def is_least(self) -> bool:
        return self.replay_fit.is_least

    def fit(
        self,
        observed: Observed,
        start: PointEstimate,
        extend_horizon: bool,
        finds_latency: bool,
        budget: Budget,
    ) -> FitResult:
        """See `ReplayFit.fit`; `finds_latency`: of the actions, if there may be one.

        Raises OutOfTime as soon as `budget` is over.
        """
        most = self.observing.max_latency_steps if finds_latency else 0
        replay_fit = self.replay_fit.within(budget)
        return replay_fit.fit(observed, start, range(most + 1), extend_horizon)

    def refit(
        self,
        observed: Observed,
        fit: FitResult,
        start: PointEstimate,
        plan: RefitPlan,
        rng: np.random.Generator,
        extend_horizon: bool,
        budget: Budget,
    ) -> Refits:
        """Film and fit known worlds near `fit`, which begin as it does and play the same actions.

        Fewer worlds than planned if `budget` is over before: an unfinished refit does not count.
        """
        like = observed.episodes(slice(plan.num_episodes))
        known = KnownWorlds(self.observing, self.model, like, fit, rng)
        replay_fit = self.replay_fit.within(budget)
        return run_bootstrap(
            replay_fit, known.synthesize, fit, start, plan.num_worlds, rng, extend_horizon, budget
        )


def _appearance(context: SearchContext) -> tuple[np.ndarray, Photometry]:
    """(N,) standard deviations of errors that no fit can detect, and what is known of colours."""
    space = context.simulator.space
    known = np.full(len(space), np.nan) if context.known is None else context.known
    photometry = Photometry(context.observation.image_noise, known)
    discrepancy = context.observation.discrepancy_std(space.is_appearance)
    return np.where(photometry.is_known, 0.0, discrepancy), photometry
