"""Fits to readings from several first guesses, over longer and longer stretches.

Over a quarter of a second a motion is nearly linear in the unknowns, from any start; over whole
episodes, with limits and swinging joints, there are many local minima. So each horizon starts where
the shorter one ended, and poor candidates are dropped.
"""

import math

import numpy as np

from simtune.budget import Budget
from simtune.fit import Descent, Guess, OutputErrorMethod, Readings
from simtune.fit.lateness import sooner_unit, steps_late
from simtune.random_streams import Purpose, stream
from simtune.tuning.readings.agreement import CLEARLY_BETTER, two_agree
from simtune.tuning.readings.horizons import AT_LATENCY, Horizon, Horizons, Latency, longest_latency

MOST_LEFT = 0.5  # steps of a delay that are left to a lateness
_START_MARGIN = 0.1  # of the range, kept from its ends: at a bound nothing moves inward
_HURRY_TIME_SHARE = 0.3  # after which two that agree suffice to go on
_HORIZON_EPISODES = 3  # that tell how far replays can be followed


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
        # The first descent of each stage, by steps and stretches: others begin with its derivatives
        self._near = dict[tuple[int, int], Descent]()

    def begin(self, first_guess: np.ndarray) -> list[Guess]:
        """The first guess, (N,) in unit coordinates, and random ones for the first horizon."""
        low, high = self._bounds
        rng, inside = stream(self._seed, Purpose.DESCENTS), _START_MARGIN * (high - low)
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
        few = self._readings.first(episodes=_HORIZON_EPISODES)
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
            stage = horizon.stage(self._horizons.iterations, readings, self._step_s)
            # If two agree, others are not better
            followed = guesses[: 2 if two_agree(ended) else horizon.guesses]
            ended = []
            for guess in followed:
                if two_agree(ended) and budget.spent > _HURRY_TIME_SHARE:
                    break
                near = self._near.get(alike := (horizon.steps(self._step_s), horizon.stretches))
                ended.append(self._method.descend(readings, guess, stage, budget, near))
                self._near.setdefault(alike, ended[0])
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
        grown = self.grow([guess], half, to_s=AT_LATENCY.seconds)[0]
        horizon = self._growing_to(AT_LATENCY.seconds)[-1]
        iterations, step_s = self._horizons.latency_iterations, self._step_s
        longest = longest_latency(self._readings, step_s)
        stage = horizon.stage(iterations, self._readings, step_s)
        best = self._method.descend(self._readings, grown.guess, stage, budget, grown)
        steps, is_known = 0, not best.is_cut_off
        for number in range(1, longest + 1):
            if not is_known:
                break
            budget.report("looking for a delay", number / longest)
            late = self._readings.delayed(number)
            begin = sooner(self._method, best.guess, number - steps)
            stage = horizon.stage(iterations, late, step_s)
            descent = self._method.descend(late, begin, stage, budget, best)
            is_known = not descent.is_cut_off
            if descent.log_rms < best.log_rms - CLEARLY_BETTER:
                best, steps = descent, number
            elif number > steps + 2:
                break
        left = float(steps_late(best.unit[-1])) if self._method.has_lateness else 0.0
        more = int(left > MOST_LEFT) - int(left < -MOST_LEFT and steps > 0)
        return sooner(self._method, best.guess, more), Latency(steps + more, is_known)


def sooner(method: OutputErrorMethod, guess: Guess, steps: int) -> Guess:
    """A guess with so many steps less of a lateness, if `method` fits that."""
    if not method.has_lateness:
        return guess
    lateness = sooner_unit(guess.unit[-1], steps)
    return guess._replace(unit=np.append(guess.unit[:-1], lateness))
