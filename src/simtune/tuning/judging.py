"""End of a round: fit the simulator, judge the fit by refits of known worlds."""

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget, OutOfTime
from simtune.fit import (
    FEW_EPISODES,
    MANY_EPISODES,
    FitResult,
    Observed,
    PointEstimate,
    Refits,
    bound_warnings,
    delay_warnings,
    is_motion_unexplained,
)
from simtune.randomization import Distribution
from simtune.tuning.earlier_rounds import EarlierRounds
from simtune.tuning.estimate import Estimate
from simtune.tuning.fit_stage import FitStage, RefitPlan
from simtune.tuning.fit_verdict import conclude, conclude_by_networks
from simtune.tuning.learning import Learning, LearningResult
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.rounds import FIT, FIT_AGAIN, REFIT, RoundTime
from simtune.tuning.search import Callbacks, SearchContext
from simtune.tuning.survival_curves import point_estimate
from simtune.verdicts import at_most_weak

_FITS_SHARE = 0.9  # of the time then left, for a fit and its refits
_FEWEST_FITS = 2  # within that time: the real fit and one refit
# Of the time left, that a fit of the planned size may take. On a machine that has become slower it
# would not end, and half a fit says nothing; the least one may still end.
_PLANNED_SHARE = 0.55
_REFIT = 0.9  # of a fit's time: no latency is searched for
_FEWEST_KNOWN = 2  # worlds that are worth a round of their own
_ENOUGH_REFITS = 4  # with time for fewer, refits have fewer episodes than the real fit
_NO_FIT = (
    "There was no time to fit the simulator: these are first guesses by networks, and none is "
    "called identified{}. Nor was any interval tested: many may miss the truth. Give it more "
    "minutes."
)
_WORTH_BEGINNING = 0.5  # of a fit's time: with more left, a refit may be finished
# Fits' time: with more left, there is time for another one and its refits; it may take so much
_WORTH_REPEATING, _REPEATED = 4.0, 1.5


class Fitted(NamedTuple):
    """A fit, and how it was made."""

    fit: FitResult
    stage: FitStage
    seconds: float  # that its first attempt took, as a refit may


class Judged(NamedTuple):
    """What a round concludes."""

    estimate: Estimate
    curves: np.ndarray  # (N, C)
    rounds: EarlierRounds  # with this one


@dataclass(frozen=True, kw_only=True)
class Judging:
    """A round's fit, and what its refits showed."""

    stage: FitStage
    start: PointEstimate  # of the fit, by the networks and by readings
    learned: LearningResult
    first: Distribution  # the range of the first round
    by_readings: ReadingsEstimate | None
    config: PosteriorSearchConfig
    learning: Learning  # films worlds to test the detector in, and draws known ones
    earlier: EarlierRounds
    picture_s: float = 0.0  # to draw a picture and to detect in it; 0: unknown

    @classmethod
    def prepare(
        cls,
        context: SearchContext,
        learning: Learning,
        learned: LearningResult,
        by_readings: ReadingsEstimate | None,
        earlier: EarlierRounds,
        budget: Budget,
        picture_s: float,
    ) -> "Judging":
        """With a fit that is as large as the time allows."""
        config, real = learning.config, learned.detected.trajectories
        start = point_estimate(learned.prob_higher, learned.searched)
        if by_readings:
            config = replace(config, fit=by_readings.fit_config(config.fit))
            start = by_readings.start(start)
        near, held_out = learning.film_near(learned, start, budget), learned.held_out
        stage = FitStage.prepare(
            context, learning.model, held_out, near, config, budget, by_readings
        )
        num_steps = min(len(t) for t in real) * len(real)
        fits, left_s = 1 + _REFIT * config.planned_refits, _FITS_SHARE * budget.seconds_left
        return cls(
            stage=stage.sized(num_steps, left_s / fits, left_s / _FEWEST_FITS),
            start=start,
            learned=learned,
            first=context.first,
            by_readings=by_readings,
            config=config,
            learning=learning,
            earlier=earlier,
            picture_s=picture_s,
        )

    def judge(self, given: RoundTime, callbacks: Callbacks) -> Judged:
        """Fit, compare with known worlds until the time is over, and conclude.

        If this cannot be the last round, known worlds and longer windows are left out. The fit's
        estimate is reported before known worlds are compared.
        """
        budget, is_last, _ = given
        budget.report("fitting", FIT[0])
        observed = self.stage.observed(*self.learned.detected)
        try:
            fitted = self._fit(observed, is_last, budget)
        except OutOfTime:
            return Judged(*self._without_fit(), self.earlier)
        plan = RefitPlan(0, 0)
        if is_last:
            fitted = self._fit_again(fitted, budget)
            budget = self._for_known_worlds(fitted.seconds, given)
            plan = self._plan_refits(observed.actions.shape[:2], fitted.seconds, budget)
        fit, stage, _ = fitted
        if plan.num_worlds:
            refits = self.earlier.refits_to_trust(Refits.none(fit))
            callbacks.report_early(self._conclude(fit, refits)[0])
        part = budget.part(budget.seconds_left, REFIT)
        rng = self.learning.worlds.rng
        made = stage.refit(observed, fit, self.start, plan, rng, is_last, part)
        refits = self.earlier.refits_to_trust(made)
        estimate, curves = self._conclude(fit, refits)
        if self._may_be_misread(fit, refits):
            budget.report("looking for other actions that explain it", REFIT[1])
            latencies = sorted({0, fit.latency_steps})
            if said := stage.replay_fit.misread_actions(observed, self.start, latencies):
                verdict = at_most_weak(estimate.verdict, fit.is_moving)
                warnings = [*said, *estimate.warnings]
                estimate = replace(estimate, verdict=verdict, warnings=warnings)
        return Judged(estimate, curves, EarlierRounds(refits, estimate))

    def _for_known_worlds(self, fit_s: float, given: RoundTime) -> Budget:
        """What is left of the round; of all rounds, where that is too short for two known worlds.

        A fit that took so much longer than planned says little before it is judged, and a later
        round's would take as long.
        """
        is_enough = given.budget.seconds_left > _FEWEST_KNOWN * _REFIT * fit_s
        is_judged = self.earlier.refits and self.earlier.refits.misfits
        return given.budget if is_enough or is_judged else given.whole

    def _may_be_misread(self, fit: FitResult, refits: Refits) -> bool:
        """Whether the motion is not explained, or by parameters at a bound.

        The best that a fit can do with a motor that is reversed is to switch it off.
        """
        space = self.first.space
        at_bound = bound_warnings(space, space.to_unit(fit.parameters), fit.is_moving)
        return is_motion_unexplained(fit, refits) or bool(at_bound)

    @property
    def _finds_latency(self) -> bool:
        return self.by_readings is None or not self.by_readings.is_used

    def _fit(self, observed: Observed, is_last: bool, budget: Budget) -> Fitted:
        """The planned fit; the least one if that took far too long, and refits are then as small.

        See `FitStage.fit`. Raises OutOfTime if the least one does not end either; it is not tried
        after a round that had a fit, which tells more.
        """
        stage = self.stage
        may_be_smaller = not (budget.is_endless or stage.is_least or self.earlier.estimate)
        seconds = _PLANNED_SHARE * budget.seconds_left if may_be_smaller else budget.seconds_left
        began_s = time.monotonic()
        try:
            part = budget.part(seconds, FIT)
            fit = stage.fit(observed, self.start, is_last, self._finds_latency, part)
        except OutOfTime:
            if not may_be_smaller:
                raise
            stage = stage.least()
            began_s = time.monotonic()
            fit = stage.fit(observed, self.start, is_last, self._finds_latency, budget)
        return Fitted(fit, stage, time.monotonic() - began_s)

    def _fit_again(self, fitted: Fitted, budget: Budget) -> Fitted:
        """Another fit, if the detector errs otherwise than in the worlds that it was tested in.

        How it errs depends on colours, of which a fit knows far more than the networks that chose
        those worlds. A peg of two pixels, whose red they had guessed .2 off, was found half a pixel
        beside its place in place of none, and a rope came out 4 to 15 % too short.
        """
        fit, stage, fit_s = fitted
        if budget.seconds_left < _WORTH_REPEATING * fit_s:
            return fitted
        budget.report("fitting", FIT_AGAIN[0])
        found = PointEstimate(fit.parameters, np.where(fit.is_moving, self.start.std, fit.std))
        noise = self.learning.film_near(self.learned, found, budget).noise()
        if not noise.is_off(stage.noise) or budget.seconds_left < _WORTH_REPEATING * fit_s:
            return fitted
        stage = replace(stage, noise=noise)
        colours = np.where(fit.is_moving, self.start.parameters, fit.parameters)
        start = self.start._replace(parameters=colours)
        try:
            observed = stage.observed(*self.learned.detected)
            seconds = budget.seconds_left if budget.is_endless else _REPEATED * fit_s
            part = budget.part(seconds, FIT_AGAIN)
            again = stage.fit(observed, start, True, self._finds_latency, part)
        except OutOfTime:
            return fitted
        return Fitted(again, stage, fit_s)

    def _without_fit(self) -> tuple[Estimate, np.ndarray]:
        """The estimate if a fit ran out of time: the previous one. Also the networks' curves.

        If there is none, that of the networks alone.
        """
        estimate, curves = conclude_by_networks(self.learned, self.stage.context)
        if self.earlier.estimate:
            return self.earlier.estimate, curves
        verdict = at_most_weak(estimate.verdict)
        of_readings = ""
        if self.by_readings:
            of_readings = " but what joint readings tell alone"
        elif self.stage.reading_labels:
            of_readings = ". Joint readings were not fitted alone, either"
        warnings = [_NO_FIT.format(of_readings)]
        estimate = replace(estimate, verdict=verdict, warnings=warnings)
        if self.by_readings:
            estimate = self.by_readings.combined_with(estimate)
        return estimate, curves

    def _plan_refits(self, fitted: tuple[int, ...], fit_s: float, budget: Budget) -> RefitPlan:
        """After a fit of `fitted` episodes and steps that took `fit_s`.

        A refit that does not end in time is dropped. Refits should resemble the real fit; with
        fewer episodes they err more. But a few small ones tell more than one or two large ones.
        """
        num_episodes, num_steps = fitted
        config = self.config
        many = min(MANY_EPISODES, num_episodes)
        few = min(FEW_EPISODES, many)
        if budget.is_endless:
            planned = config.planned_refits
            return RefitPlan(planned, few if planned < _ENOUGH_REFITS else many)
        each_s, film_s = budget.seconds_left / _ENOUGH_REFITS, (num_steps + 1) * self.picture_s
        # A refit may take less time, since no latency is searched for.
        is_worth_it = budget.seconds_left > _WORTH_BEGINNING * fit_s + few * film_s
        episodes = int(np.clip(each_s / (fit_s / num_episodes + film_s), few, many))
        return RefitPlan(config.most_refits if is_worth_it else 0, episodes)

    def _conclude(self, fit: FitResult, refits: Refits) -> tuple[Estimate, np.ndarray]:
        estimate, curves = conclude(
            self.learned.prob_higher,
            fit,
            refits,
            self.learned.searched,
            self.first,
            self.config.range_update,
        )
        estimate = replace(estimate, warnings=[*estimate.warnings, *self._delays(fit)])
        if len(fit.offsets):
            offsets = zip(self.stage.reading_labels, fit.offsets.tolist(), strict=True)
            estimate = replace(estimate, offsets=dict(offsets))
        return self.by_readings.combined_with(estimate) if self.by_readings else estimate, curves

    def _delays(self, fit: FitResult) -> list[str]:
        """Warnings of what comes late; actions that readings call late were shifted before."""
        steps = fit.latency_steps + (self.by_readings.latency_steps if self.by_readings else 0)
        return delay_warnings(fit.late_s, steps, self.stage.context.simulator.step_s)
