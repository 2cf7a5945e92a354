"""End of a round: fit the simulator, judge the fit by refits of known worlds."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget, OutOfTime
from simtune.fit import (
    FitResult,
    Observed,
    Refits,
    bound_warnings,
    delay_warnings,
    is_motion_unexplained,
    what_is_unexplained,
)
from simtune.tuning.earlier_rounds import EarlierRounds
from simtune.tuning.estimate import Estimate
from simtune.tuning.fit_verdict import conclude, conclude_by_networks
from simtune.tuning.fitting import REFIT_TIME, Fitted, Fitting
from simtune.tuning.readings.estimate import ReadingsEstimate
from simtune.tuning.refit_plan import RefitPlan
from simtune.tuning.rounds import FIT, REFIT, RoundTime
from simtune.tuning.search import Callbacks, SearchContext
from simtune.verdicts import at_most_weak

_MIN_KNOWN_WORLDS = 2  # that are worth a round of their own
_NO_FIT = (
    "There was no time to fit the simulator: these are first guesses by networks, and none is "
    "called identified{}. Nor was any interval tested: many may miss the truth. Give it more "
    "minutes."
)


class Judged(NamedTuple):
    """What a round concludes."""

    estimate: Estimate
    curves: np.ndarray  # (N, C)
    earlier: EarlierRounds  # with this one


@dataclass(frozen=True, kw_only=True)
class Judging:
    """A round's fit, and what its refits showed."""

    context: SearchContext
    fitting: Fitting
    by_readings: ReadingsEstimate | None
    earlier: EarlierRounds
    picture_s: float = 0.0  # to draw a picture and to detect in it; 0: unknown

    def judge(self, given: RoundTime, callbacks: Callbacks) -> Judged:
        """Fit, compare with known worlds until the time is over, and conclude.

        If this cannot be the last round, known worlds and longer windows are left out. The fit's
        estimate is reported before known worlds are compared.
        """
        budget = given.budget
        budget.report("fitting", FIT[0])
        observed = self.fitting.observed()
        try:
            fitted = self.fitting.fit(observed, given.is_last, budget)
        except OutOfTime:
            return Judged(*self._without_fit(), self.earlier)
        if given.is_last:
            fitted = self.fitting.again(fitted, budget)
        made = self._fit_known_worlds(fitted, observed, given, callbacks)
        refits = self.earlier.refits_to_trust(made)
        estimate, curves = self._conclude(fitted.fit, refits)
        if self._may_be_misread(fitted.fit, refits):
            budget.report("looking for other actions that explain it", REFIT[1])
            estimate = self._unless_misread(estimate, fitted, observed)
        return Judged(estimate, curves, EarlierRounds(refits, estimate))

    def _fit_known_worlds(
        self, fitted: Fitted, observed: Observed, given: RoundTime, callbacks: Callbacks
    ) -> Refits:
        """As many as there is time for; none if this cannot be the last round."""
        fit, fit_s = fitted.fit, fitted.seconds
        if not given.is_last:
            return Refits.none(fit)
        budget = self._for_known_worlds(fit_s, given)
        size, config = observed.actions.shape[:2], self.fitting.learning.config
        plan = RefitPlan.within(budget, size, fit_s, self.picture_s, config)
        if plan.num_worlds:
            refits = self.earlier.refits_to_trust(Refits.none(fit))
            callbacks.report_early(self._conclude(fit, refits)[0])
        part = budget.part(budget.seconds_left, REFIT)
        return self.fitting.refit(fitted, observed, plan, part)

    def _for_known_worlds(self, fit_s: float, given: RoundTime) -> Budget:
        """What is left of the round; of all rounds, where that is too short for two known worlds.

        A fit that took so much longer than planned says little before it is judged, and a later
        round's would take as long.
        """
        is_enough = given.budget.seconds_left > _MIN_KNOWN_WORLDS * REFIT_TIME * fit_s
        is_judged = self.earlier.refits and self.earlier.refits.misfits
        return given.budget if is_enough or is_judged else given.whole

    def _may_be_misread(self, fit: FitResult, refits: Refits) -> bool:
        """Whether the motion is not explained, or by parameters at a bound.

        The best that a fit can do with a motor that is reversed is to switch it off.
        """
        space = self.context.simulator.space
        at_bound = bound_warnings(space, space.to_unit(fit.parameters), fit.is_moving)
        return is_motion_unexplained(fit, refits) or bool(at_bound)

    def _unless_misread(self, estimate: Estimate, fitted: Fitted, observed: Observed) -> Estimate:
        """The estimate, doubted if other actions than the recorded ones explain far more."""
        fit, latencies = fitted.fit, sorted({0, fitted.fit.latency_steps})
        start = self.fitting.start
        if not (said := fitted.replay_fit.misread_actions(observed, start, latencies)):
            return estimate
        verdict = at_most_weak(estimate.verdict, fit.is_moving)
        return replace(estimate, verdict=verdict, warnings=[*said, *estimate.warnings])

    def _without_fit(self) -> tuple[Estimate, np.ndarray]:
        """The estimate if a fit ran out of time: the previous one. Also the networks' curves.

        If there is none, that of the networks alone.
        """
        estimate, curves = conclude_by_networks(self.fitting.learned, self.context)
        if self.earlier.estimate:
            return self.earlier.estimate, curves
        verdict = at_most_weak(estimate.verdict)
        of_readings = ""
        if self.by_readings:
            of_readings = " but what joint readings tell alone"
        elif self.context.observation.reading_labels:
            of_readings = ". Joint readings were not fitted alone, either"
        warnings = [_NO_FIT.format(of_readings)]
        estimate = replace(estimate, verdict=verdict, warnings=warnings)
        if self.by_readings:
            estimate = self.by_readings.combined_with(estimate)
        return estimate, curves

    def _conclude(self, fit: FitResult, refits: Refits) -> tuple[Estimate, np.ndarray]:
        learned, first = self.fitting.learned, self.context.first
        estimate, curves = conclude(learned.prob_higher, fit, refits, learned.searched, first)
        estimate = replace(estimate, warnings=[*estimate.warnings, *self._delays(fit)])
        if len(fit.offsets):
            labels = self.context.observation.reading_labels
            offsets = dict(zip(labels, fit.offsets.tolist(), strict=True))
            estimate = replace(estimate, offsets=offsets)
        if self.by_readings:
            unexplained = what_is_unexplained(fit, refits)
            estimate = self.by_readings.combined_with(estimate, unexplained)
        return estimate, curves

    def _delays(self, fit: FitResult) -> list[str]:
        """Warnings of what comes late; actions that readings call late were shifted before."""
        steps = fit.latency_steps + (self.by_readings.latency_steps if self.by_readings else 0)
        return delay_warnings(fit.late_s, steps, self.context.simulator.step_s)
