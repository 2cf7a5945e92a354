"""Horizons of fits to readings, and the latency that is looked for at one of them."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from simtune.fit import FEWEST_STEPS, Readings, ReplayStage
from simtune.fit.readings.segments import Segments

_LONGEST_LATENCY_S = 0.5


class Horizon(NamedTuple):
    seconds: float
    guesses: int  # starts that are followed
    stretches: int  # at most; more hardly add information

    def share(self, steps: int, step_s: float) -> float:
        """Of all steps of the episodes, those that lie in its stretches."""
        return min(self.seconds / step_s * self.stretches / steps, 1.0)

    def steps(self, step_s: float) -> int:
        """Of a stretch."""
        return max(FEWEST_STEPS, round(self.seconds / step_s))

    def stage(self, iterations: int, readings: Readings, step_s: float) -> ReplayStage:
        """So many iterations at it."""
        segments = Segments.evenly(readings, self.steps(step_s), self.stretches)
        return ReplayStage(iterations, segments)


# Shares of the iterations that are made, and latencies that are tried, usually
_GROWING_SHARE, _LATENCY_SHARE, _NUM_LATENCIES = 0.25, 0.45, 4
AT_LATENCY = Horizon(1.0, 1, 24)  # horizon at which a latency is searched for


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
        before = [h for h in self.growing if h.seconds <= AT_LATENCY.seconds]
        latency = self.iterations * sum(h.share(steps, step_s) for h in before)
        latency += _NUM_LATENCIES * self.latency_iterations * AT_LATENCY.share(steps, step_s)
        return _GROWING_SHARE * self.iterations * grown + _LATENCY_SHARE * latency * may_be_late


def most_latency_steps(step_s: float) -> int:
    """The largest number of steps that `find_latency` may find."""
    return math.ceil(_LONGEST_LATENCY_S / step_s) + 1


def longest_latency(readings: Readings, step_s: float) -> int:
    """The longest latency in steps that is looked for in these readings."""
    left = readings.values.shape[1] - 1 - FEWEST_STEPS
    return min(most_latency_steps(step_s) - 1, left)
