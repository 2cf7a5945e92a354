"""A round's fit to the real episodes: as large as the time allows, and again if that helps."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget, OutOfTime, timed
from simtune.fit import FitResult, Observed, PointEstimate, Refits, ReplayFit, run_bootstrap
from simtune.tuning.known_worlds import KnownWorlds
from simtune.tuning.learning import Learning, LearningResult
from simtune.tuning.observing import Observing
from simtune.tuning.prepare_fit import prepare_fit
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.refit_plan import RefitPlan
from simtune.tuning.rounds import FIT, FIT_AGAIN
from simtune.tuning.search import SearchContext
from simtune.tuning.survival_curves import point_estimate

REFIT_TIME = 0.9  # of a fit's: no latency is searched for
_FITS_SHARE = 0.9  # of the time then left, for a fit and its refits
_FEWEST_FITS = 2  # within that time: the real fit and one refit
# Of the time left, that a fit of the planned size may take. On a machine that has become slower it
# would not end, and half a fit says nothing; the least one may still end.
_PLANNED_SHARE = 0.55
# Fits' time: with more left, there is time for another one and its refits; it may take so much
_REPEAT_TIME_LEFT, _REPEAT_TIME = 4.0, 1.5


class Fitted(NamedTuple):
    """A fit, and how it was made."""

    fit: FitResult
    replay_fit: ReplayFit
    observing: Observing
    seconds: float  # that its first attempt took, as a refit may


@dataclass(frozen=True, kw_only=True)
class Fitting:
    """What is fitted, and from where."""

    replay_fit: ReplayFit  # treats all worlds alike
    observing: Observing  # what is fitted, real and known
    start: PointEstimate  # by the networks and by readings
    learning: Learning  # films worlds to test the detector in
    learned: LearningResult
    finds_latency: bool  # of the actions, if there may be one
    may_give_up: bool  # an earlier round had a fit, which tells more than the least one now

    @classmethod
    def prepare(
        cls,
        context: SearchContext,
        learning: Learning,
        learned: LearningResult,
        by_readings: ReadingsEstimate | None,
        may_give_up: bool,
        budget: Budget,
    ) -> "Fitting":
        """With a fit that is as large as the time allows."""
        config, real = learning.config, learned.detected.trajectories
        start = point_estimate(learned.prob_higher, learned.searched)
        if by_readings:
            config = replace(config, fit=by_readings.fit_config(config.fit))
            start = by_readings.start(start)
        near, held_out = learning.film_near(learned, start, budget), learned.held_out
        replay_fit, observing = prepare_fit(
            context, held_out, near, real, config, by_readings, budget
        )
        num_steps = min(len(t) for t in real) * len(real)
        fits, left_s = 1 + REFIT_TIME * config.planned_refits, _FITS_SHARE * budget.seconds_left
        return cls(
            replay_fit=replay_fit.sized(num_steps, left_s / fits, left_s / _FEWEST_FITS),
            observing=observing,
            start=start,
            learning=learning,
            learned=learned,
            finds_latency=by_readings is None or not by_readings.is_used,
            may_give_up=may_give_up,
        )

    def observed(self) -> Observed:
        """The real episodes, as a fit sees them."""
        return self.observing.observed(*self.learned.detected)

    def fit(self, observed: Observed, is_last: bool, budget: Budget) -> Fitted:
        """The planned fit; the least one if that took far too long, and refits are then as small.

        `is_last`: whether to extend the horizon. Raises OutOfTime if the least one does not end
        either.
        """
        replay_fit = self.replay_fit
        may_be_smaller = not (budget.is_endless or replay_fit.is_least or self.may_give_up)
        seconds = _PLANNED_SHARE * budget.seconds_left if may_be_smaller else budget.seconds_left
        part = budget.part(seconds, FIT)
        try:
            took_s, fit = timed(lambda: self._fit(replay_fit, observed, self.start, is_last, part))
        except OutOfTime:
            if not may_be_smaller:
                raise
            replay_fit = least = replay_fit.least()
            took_s, fit = timed(lambda: self._fit(least, observed, self.start, is_last, budget))
        return Fitted(fit, replay_fit, self.observing, took_s)

    def again(self, fitted: Fitted, budget: Budget) -> Fitted:
        """Another fit, if the detector errs otherwise than in the worlds that it was tested in.

        How it errs depends on colours, of which a fit knows far more than the networks that chose
        those worlds. A peg of two pixels, whose red they had guessed .2 off, was found half a pixel
        beside its place in place of none, and a rope came out 4 to 15 % too short.
        """
        fit, replay_fit, before, fit_s = fitted
        least_s = _REPEAT_TIME_LEFT * fit_s
        if budget.seconds_left < least_s:
            return fitted
        budget.report("fitting", FIT_AGAIN[0])
        found = PointEstimate(fit.parameters, np.where(fit.is_moving, self.start.std, fit.std))
        noise = self.learning.film_near(self.learned, found, budget).noise()
        if not noise.is_off(before.noise) or budget.seconds_left < least_s:
            return fitted
        observing = replace(before, noise=noise)
        colours = np.where(fit.is_moving, self.start.parameters, fit.parameters)
        start = self.start._replace(parameters=colours)
        try:
            observed = observing.observed(*self.learned.detected)
            seconds = budget.seconds_left if budget.is_endless else _REPEAT_TIME * fit_s
            part = budget.part(seconds, FIT_AGAIN)
            again = self._fit(replay_fit, observed, start, True, part)
        except OutOfTime:
            return fitted
        return Fitted(again, replay_fit, observing, fit_s)

    def refit(self, fitted: Fitted, observed: Observed, plan: RefitPlan, budget: Budget) -> Refits:
        """Film and fit known worlds near a fit, which begin as it does and play the same actions.

        Fewer worlds than planned if `budget` is over before: an unfinished refit does not count.
        """
        like, rng = observed.episodes(slice(plan.num_episodes)), self.learning.worlds.rng
        known = KnownWorlds(fitted.observing, self.learning.model, like, fitted.fit, rng)
        replay_fit, num = fitted.replay_fit.within(budget), plan.num_worlds
        return run_bootstrap(replay_fit, known.synthesize, fitted.fit, self.start, num, rng, budget)

    def _fit(
        self,
        replay_fit: ReplayFit,
        observed: Observed,
        start: PointEstimate,
        extend_horizon: bool,
        budget: Budget,
    ) -> FitResult:
        """See `ReplayFit.fit`. Raises OutOfTime as soon as `budget` is over."""
        most = self.observing.max_latency_steps if self.finds_latency else 0
        return replay_fit.within(budget).fit(observed, start, range(most + 1), extend_horizon)
