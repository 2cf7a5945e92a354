"""Fits to whole episodes, as far as replays can follow them, until two end at the same answer."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit import Descent, Guess, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.lateness import steps_late
from simtune.fit.readings.segments import Segments
from simtune.observation import declared_noise
from simtune.random_streams import Purpose, stream
from simtune.tuning.readings.agreement import (
    CLEARLY_BETTER,
    BestDescent,
    agree,
    best_of,
    two_agree,
    unexplained,
)
from simtune.tuning.readings.descents import MOST_LEFT, sooner
from simtune.tuning.readings.horizons import Horizons, Latency

_MAX_NOISE_FACTOR = 1.5  # on the noise that a sensor declares
_SIDESTEPS = (0.03, 0.1)  # in unit coordinates, from which a fit should return
_FEW_FITS = 4  # to whole episodes, if two of stretches agree
_MOST_CUTS = 3  # of episodes into segments, before other fits
_ONE_WAY_FITS = 2  # of these start with all parameters higher or all lower


class _Whole(NamedTuple):
    """A fit to whole episodes, what of them others are to fit, and the seconds it took."""

    descent: Descent
    segments: Segments
    took_s: float


@dataclass(frozen=True)
class WholeFits:
    """Of readings, from where descents on stretches ended."""

    method: OutputErrorMethod
    readings: Readings
    moving: np.ndarray  # (N,) bool: parameters that are fitted
    horizons: Horizons
    longest_latency: int  # in steps
    seed: int

    def fit_until_two_agree(
        self, ended: list[Descent], latency: Latency, budget: Budget
    ) -> tuple[BestDescent, Latency]:
        """Fit whole episodes from successive starts until the two best agree.

        `ended`: descents at the last horizon, at this `latency`. The result's may be another one,
        see `_step_on`. If no two fits of whole episodes agree (they may depend on the least
        change), but two of `ended` do and leave only the sensors' declared noise, those are the
        result. A simulator that lacks something must fit whole episodes.
        """
        readings = self.readings.delayed(latency.steps)
        whole = self._first_whole(readings, ended[0].guess, budget)
        while further := self._step_on(whole, latency, budget):
            whole, latency = further
            readings, ended = self.readings.delayed(latency.steps), [whole.descent]
        first, segments, took_s = whole
        rng, fits = stream(self.seed, Purpose.WHOLE_EPISODES), [first]
        most = _FEW_FITS if self._is_enough(ended) else self.horizons.most_fits
        while len(fits) < most:
            best = min(fits, key=lambda descent: descent.log_rms)
            if self._is_found(fits, best) or budget.seconds_left <= took_s:
                break
            budget.report("replaying whole episodes", len(fits) / self.horizons.most_fits)
            # Next to the best, since other candidates may lie elsewhere in the same valley
            guess = self._start_near(best, rng, len(fits) <= _ONE_WAY_FITS)
            fits.append(self._descend(readings, guess, segments, budget, best))
        is_whole = agree(fits, self.moving) or not self._is_enough(ended)
        found = best_of(fits if is_whole else ended, self.moving, is_whole)
        lacked_time = not found.is_sure and len(fits) < most
        return found._replace(lacked_time=lacked_time), latency

    def _step_on(
        self, whole: _Whole, latency: Latency, budget: Budget
    ) -> tuple[_Whole, Latency] | None:
        """The fit of a latency a step away, if over half a step is left and that one is better.

        Stretches tell less of a delay than whole episodes do: where a motor lags, next to nothing.
        """
        if not self.method.has_lateness or budget.seconds_left <= whole.took_s:
            return None
        left = float(steps_late(whole.descent.unit[-1]))
        more = int(np.sign(left)) if abs(left) > MOST_LEFT else 0
        steps = latency.steps + more
        if not more or not 0 <= steps <= self.longest_latency:
            return None
        guess = sooner(self.method, whole.descent.guess, more)
        further = self._first_whole(self.readings.delayed(steps), guess, budget)
        gain = whole.descent.log_rms - further.descent.log_rms
        is_better = gain > (0 if further.segments.are(whole.segments) else CLEARLY_BETTER)
        return (further, latency._replace(steps=steps)) if is_better else None

    def _first_whole(self, readings: Readings, guess: Guess, budget: Budget) -> _Whole:
        """A fit to whole episodes, as far as replays can follow them.

        How far that is depends on the parameters. So what a fit finds is asked again, and the fit
        is repeated if it follows other segments, until these are the same as once before: of two
        that lead to each other, the first is as good. There must be time for a second fit to them.
        """
        budget.report("replaying whole episodes", 0.0)
        segments, fits = self.method.follow(readings, guess), list[tuple[Segments, Descent]]()
        while True:
            left_s = budget.seconds_left
            descent = self._descend(readings, guess, segments, budget)
            took_s = left_s - budget.seconds_left
            fits.append((segments, descent))
            guess = descent.guess
            segments = self.method.follow(readings, guess)
            before = [fit for fit in fits if fit[0].are(segments)]
            if before or len(fits) == _MOST_CUTS or budget.seconds_left <= 2 * took_s:
                segments, descent = (before or fits)[-1]
                return _Whole(descent, segments, took_s)

    def _descend(
        self,
        readings: Readings,
        guess: Guess,
        segments: Segments,
        budget: Budget,
        near: Descent | None = None,
    ) -> Descent:
        stage = ReplayStage(self.horizons.whole_iterations, segments, goes_on=True)
        return self.method.descend(readings, guess, stage, budget, near)

    def _is_found(self, fits: list[Descent], best: Descent) -> bool:
        """Whether fits to whole episodes agree and leave no more than noise."""
        is_off = unexplained(best.noise, self.method.sensors).any()
        return agree(fits, self.moving) and not is_off

    def _is_enough(self, ended: list[Descent]) -> bool:
        """Whether two descents at the last horizon agree and leave little more than noise."""
        noise = min(ended, key=lambda descent: descent.log_rms).noise
        declared = declared_noise(self.method.sensors)
        left = noise < _MAX_NOISE_FACTOR * declared
        return two_agree(ended) and bool((left & np.isfinite(declared)).all())

    def _start_near(self, best: Descent, rng: np.random.Generator, together: bool) -> Guess:
        """A start near the best, with all parameters higher or lower `together`, or at random."""
        away = rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(*np.log(_SIDESTEPS)))
        step = away * self.moving * (1.0 if together else rng.normal(size=len(best.unit)))
        step *= max(1.0, _SIDESTEPS[0] / max(np.abs(step).max(), 1e-9))
        beyond = (best.unit + step < 0) | (best.unit + step > 1)
        unit = best.unit + np.where(beyond, -step, step)  # at a bound, inward
        return Guess(np.clip(unit, 0, 1), best.guess.offsets)
