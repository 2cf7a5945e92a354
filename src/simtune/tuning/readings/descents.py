"""Fits to readings from several first guesses, over longer and longer stretches.

Over a quarter of a second a motion is nearly linear in the unknowns, from any start; over whole
episodes, with limits and swinging joints, there are many local minima. So each horizon starts where
the shorter one ended, and poor candidates are dropped.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit import (
    FEWEST_STEPS,
    Descent,
    Guess,
    Lateness,
    OutputErrorMethod,
    Readings,
    ReplayStage,
)
from simtune.fit.readings.segments import Segments
from simtune.observation import declared_noise
from simtune.tuning.readings.agreement import (
    CLEARLY_BETTER,
    BestDescent,
    agree,
    best_of,
    two_agree,
    unexplained,
)

_LITTLE_MORE = 1.5  # factor on the noise that a sensor declares
_LONGEST_LATENCY_S = 0.5
_MOST_LEFT = 0.5  # steps of a delay that are left to a lateness
_INSIDE = 0.1  # of the range, kept from its ends: at a bound nothing moves inward
_SIDESTEPS = (0.03, 0.1)  # in unit coordinates, from which a fit should return
_FEW_FITS = 4  # to whole episodes, if two of stretches agree
_HURRY = 0.3  # share of the time, after which two that agree suffice to go on
_MOST_CUTS = 3  # of episodes into segments, before other fits
_FEW = 3  # episodes that tell how far replays can be followed
_TOGETHER = 2  # of these fits start with all parameters higher or all lower


class Horizon(NamedTuple):
    seconds: float
    guesses: int  # starts that are followed
    stretches: int  # at most; more hardly add information

    def share(self, steps: int, step_s: float) -> float:
        """Of all steps of the episodes, those that lie in its stretches."""
        return min(self.seconds / step_s * self.stretches / steps, 1.0)


# Shares of the iterations that are made, and latencies that are tried, usually
_GROWING, _LOOKING, _LATENCIES = 0.25, 0.45, 4
_AT_LATENCY = Horizon(1.0, 1, 24)  # horizon at which a latency is searched for


class Latency(NamedTuple):
    """Of actions."""

    steps: int = 0
    is_known: bool = True  # False: there was no time to look for a longer one


@dataclass(frozen=True, kw_only=True)
class Horizons:
    """Successive horizons, and iterations at each."""

    growing: tuple[Horizon, ...] = (
        Horizon(0.25, 5, 48),
        Horizon(0.5, 3, 24),
        Horizon(1.0, 3, 24),
        Horizon(2.0, 2, 12),
    )
    iterations: int = 6
    latency_iterations: int = 3
    whole_iterations: int = 15
    most_fits: int = 8  # to whole episodes

    def derivatives(self, steps: int, step_s: float, may_be_late: bool) -> float:
        """About how many, of episodes with so many steps in all, are taken before whole ones are
        fitted: descents end early, and less often where a latency is looked for.
        """
        grown = sum(h.share(steps, step_s) * h.guesses for h in self.growing)
        before = [h for h in self.growing if h.seconds <= _AT_LATENCY.seconds]
        latency = self.iterations * sum(h.share(steps, step_s) for h in before)
        latency += _LATENCIES * self.latency_iterations * _AT_LATENCY.share(steps, step_s)
        return _GROWING * self.iterations * grown + _LOOKING * latency * may_be_late


class ReadingsDescents:
    """Descents on readings of whole episodes."""

    def __init__(
        self,
        method: OutputErrorMethod,
        readings: Readings,
        step_s: float,
        bounds: tuple[np.ndarray, np.ndarray],
        horizons: Horizons,
        seed: int,
    ):
        """`bounds`: (N,) low and high of the starts, in unit coordinates; equal for a parameter
        that only pictures show.
        """
        self._method, self._readings, self._step_s, self._seed = method, readings, step_s, seed
        self._bounds, self._horizons = bounds, horizons
        self._followed_s = math.inf  # see `_measure_followed`
        # The first descent of each stage, by (steps, at_most): others begin with its derivatives
        self._near = dict[tuple[int | None, int | None], Descent]()

    def begin(self, first_guess: np.ndarray) -> list[Guess]:
        """The first guess, (N,) in unit coordinates, and random ones for the first horizon."""
        low, high = self._bounds
        rng, inside = np.random.default_rng((self._seed, 2)), _INSIDE * (high - low)
        units = [np.clip(first_guess, low + inside, high - inside)]
        count = self._horizons.growing[0].guesses
        units += [rng.uniform(low, high) for _ in range(count - 1)]
        guesses = [Guess(unit, np.zeros(self._readings.values.shape[-1])) for unit in units]
        self._followed_s = self._measure_followed(guesses[0])
        return guesses

    def _measure_followed(self, guess: Guess) -> float:
        """The seconds for which half of a few episodes, or more, can be followed open loop.

        Stretches that are longer lead astray: a robot that a controller balances falls in them.
        """
        few = Readings(self._readings.actions[:_FEW], self._readings.values[:_FEW])
        steps = self._method.followed(few, guess).steps
        if not steps.any():
            return 0.0
        if steps.min() == few.actions.shape[1]:
            return math.inf
        return float(np.median(np.repeat(steps, steps))) * self._step_s

    def grow(
        self, guesses: list[Guess], budget: Budget, latency_steps: int = 0, to_s: float = math.inf
    ) -> list[Descent]:
        """Descents at the last horizon that can be followed, or at `to_s`, best first."""
        readings, ended = self._readings.delayed(latency_steps), list[Descent]()
        horizons = self._growing_to(to_s)
        for number, horizon in enumerate(horizons):
            budget.report(f"fitting stretches of {horizon.seconds:g} s", number / len(horizons))
            stage = self._stage(horizon, self._horizons.iterations)
            # If two agree, others are not better
            followed = guesses[: 2 if two_agree(ended) else horizon.guesses]
            ended = []
            for guess in followed:
                if two_agree(ended) and budget.spent > _HURRY:
                    break
                near = self._near.get(stretches := (stage.steps, stage.at_most))
                ended.append(self._method.descend(readings, guess, stage, budget, near))
                self._near.setdefault(stretches, ended[0])
            ended.sort(key=lambda descent: descent.log_rms)
            guesses = [descent.guess for descent in ended]
        return ended

    def _growing_to(self, seconds: float) -> list[Horizon]:
        """Those that can be followed, and the first one in any case."""
        first, *longer = self._horizons.growing
        return [first, *(h for h in longer if h.seconds <= min(seconds, self._followed_s))]

    def find_latency(self, guess: Guess, budget: Budget) -> tuple[Guess, Latency]:
        """The latency of actions, if one explains clearly more.

        `guess`: a first one; also returns the best one found. Each number of steps starts from the
        lateness that leaves the whole delay as it was. Of two numbers that allow for it, the one
        is taken that leaves at most half a step: at the end of its range, a lateness hides the
        rest of a delay, and a servo's damping takes its place.
        """
        half = budget.part(budget.seconds_left / 2, (0.0, 0.5))  # the rest is to look for it
        grown = self.grow([guess], half, to_s=_AT_LATENCY.seconds)[0]
        horizon = self._growing_to(_AT_LATENCY.seconds)[-1]
        stage = self._stage(horizon, self._horizons.latency_iterations)
        left = self._readings.values.shape[1] - 1 - FEWEST_STEPS
        longest = min(most_latency_steps(self._step_s) - 1, left)
        best = self._method.descend(self._readings, grown.guess, stage, budget, grown)
        steps, is_known = 0, not best.is_cut_off
        for number in range(1, longest + 1):
            if not is_known:
                break
            budget.report("looking for a delay", number / longest)
            late = self._readings.delayed(number)
            begin = self._sooner(best.guess, number - steps)
            descent = self._method.descend(late, begin, stage, budget, best)
            is_known = not descent.is_cut_off
            if descent.log_rms < best.log_rms - CLEARLY_BETTER:
                best, steps = descent, number
            elif number > steps + 2:
                break
        left = float(Lateness.steps(best.unit[-1])) if self._method.has_lateness else 0.0
        more = int(left > _MOST_LEFT) - int(left < -_MOST_LEFT and steps > 0)
        return self._sooner(best.guess, more), Latency(steps + more, is_known)

    def _sooner(self, guess: Guess, steps: int) -> Guess:
        """With so many steps less of a lateness, if that is fitted."""
        if not self._method.has_lateness:
            return guess
        lateness = Lateness.shifted(guess.unit[-1], steps)
        return guess._replace(unit=np.append(guess.unit[:-1], lateness))

    def fit_until_two_agree(
        self, ended: list[Descent], latency_steps: int, budget: Budget
    ) -> BestDescent:
        """Fit whole episodes from successive starts until the two best agree.

        `ended`: descents at the last horizon. If no two fits of whole episodes agree (they may
        depend on the least change), but two of `ended` do and leave only the sensors' declared
        noise, those are the result. A simulator that lacks something must fit whole episodes.
        """
        readings = self._readings.delayed(latency_steps)
        first, stage, took_s = self._first_whole(readings, ended[0].guess, budget)
        rng, fits = np.random.default_rng((self._seed, 1)), [first]
        most = _FEW_FITS if self._is_enough(ended) else self._horizons.most_fits
        while len(fits) < most:
            best = min(fits, key=lambda descent: descent.log_rms)
            if self._is_found(fits, best) or budget.seconds_left <= took_s:
                break
            budget.report("replaying whole episodes", len(fits) / self._horizons.most_fits)
            # Next to the best, since other candidates may lie elsewhere in the same valley
            guess = self._start_near(best, rng, len(fits) <= _TOGETHER)
            fits.append(self._method.descend(readings, guess, stage, budget, best))
        is_whole = agree(fits, self._moving) or not self._is_enough(ended)
        return best_of(fits if is_whole else ended, self._moving, is_whole)

    def _first_whole(
        self, readings: Readings, guess: Guess, budget: Budget
    ) -> tuple[Descent, ReplayStage, float]:
        """A fit to whole episodes, as far as replays can follow them, and the seconds it took.

        How far that is depends on the parameters. So what a fit finds is asked again, and the fit
        is repeated if it follows other segments, until these are the same as once before: of two
        that lead to each other, the first is as good. There must be time for a second fit to them.
        """
        budget.report("replaying whole episodes", 0.0)
        segments, fits = self._method.follow(readings, guess), list[tuple[Segments, Descent]]()
        while True:
            left_s = budget.seconds_left
            stage = ReplayStage(self._horizons.whole_iterations, segments=segments)
            descent = self._method.descend(readings, guess, stage, budget)
            took_s = left_s - budget.seconds_left
            fits.append((segments, descent))
            guess = descent.guess
            segments = self._method.follow(readings, guess)
            before = [fit for fit in fits if fit[0].are(segments)]
            if before or len(fits) == _MOST_CUTS or budget.seconds_left <= 2 * took_s:
                segments, descent = (before or fits)[-1]
                return descent, stage._replace(segments=segments), took_s

    def _is_found(self, fits: list[Descent], best: Descent) -> bool:
        """Whether fits to whole episodes agree and leave no more than noise."""
        is_off = unexplained(best.noise, self._method.sensors).any()
        return agree(fits, self._moving) and not is_off

    def _is_enough(self, ended: list[Descent]) -> bool:
        """Whether two descents at the last horizon agree and leave little more than noise."""
        noise = min(ended, key=lambda descent: descent.log_rms).noise
        declared = declared_noise(self._method.sensors)
        left = noise < _LITTLE_MORE * declared
        return two_agree(ended) and bool((left & np.isfinite(declared)).all())

    def _start_near(self, best: Descent, rng: np.random.Generator, together: bool) -> Guess:
        """A start near the best, with all parameters higher or lower `together`, or at random."""
        away = rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(*np.log(_SIDESTEPS)))
        step = away * self._moving * (1.0 if together else rng.normal(size=len(best.unit)))
        step *= max(1.0, _SIDESTEPS[0] / max(np.abs(step).max(), 1e-9))
        beyond = (best.unit + step < 0) | (best.unit + step > 1)
        unit = best.unit + np.where(beyond, -step, step)  # at a bound, inward
        return Guess(np.clip(unit, 0, 1), best.guess.offsets)

    @property
    def _moving(self) -> np.ndarray:
        """(N,) bool"""
        return self._bounds[0] < self._bounds[1]

    def _stage(self, horizon: Horizon, iterations: int) -> ReplayStage:
        steps = max(FEWEST_STEPS, round(horizon.seconds / self._step_s))
        return ReplayStage(iterations, steps, horizon.stretches)


def most_latency_steps(step_s: float) -> int:
    """The largest number of steps that `ReadingsDescents.find_latency` may find."""
    return math.ceil(_LONGEST_LATENCY_S / step_s) + 1
