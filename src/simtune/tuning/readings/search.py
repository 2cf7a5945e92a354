"""Search by joint readings alone, without a camera or a detector.

Readings replace the networks that video needs: they give each episode's initial state. There is a
single round:

    far      short stretches, from several first guesses: nearly linear, so no local minima
    latency  number of steps by which actions are late, if no parameter describes it; the rest,
             less than a step, is fitted as well
    whole    open-loop replay of whole episodes, or of segments as long as replays can be followed:
             the actual objective
    again    from other starts, until two end at the best: contacts and limits make it rough
    judge    uncertainty, and what the model cannot explain
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.columns import episode_in_words
from simtune.errors import InputError
from simtune.fit import (
    FEWEST_STEPS,
    OpenLoopReplay,
    OutputErrorMethod,
    Readings,
    recorded_loop,
    where_starts_show,
)
from simtune.fit.lateness import late_unit
from simtune.fit.readings.weak_directions import MOST_WORLDS
from simtune.observation import finds_offset
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.pace import MOST_REPLAYED, slow_steps
from simtune.tuning.readings.agreement import BestDescent
from simtune.tuning.readings.descents import ReadingsDescents
from simtune.tuning.readings.horizons import Horizons, Latency, longest_latency
from simtune.tuning.readings.verdict import ReadingsResult, conclude
from simtune.tuning.readings.warnings import Unmeasured
from simtune.tuning.readings.whole import WholeFits
from simtune.tuning.rounds import half_widths, is_precise
from simtune.tuning.search import (
    NO_CALLBACKS,
    Callbacks,
    Event,
    Round,
    Search,
    SearchContext,
    TimeNeeded,
)

_JUDGING_SHARE = 0.15  # of the time left for whole episodes
# Times relative to derivatives of whole episodes: judging, fits to them, what check would say
_JUDGING_TIME, _WHOLE_SEARCH_TIME, _CHECK_TIME = 1.2, 15.0, 1.5


class ReadingsSearch(Search):
    """Uses joint readings only."""

    def __init__(self, context: SearchContext, precision: float = 0.01):
        """`precision`: as of other searches, but it decides only what is said at the end.

        The search ends as soon as two fits agree, and another round could add nothing to that.
        Raises InputError without a MuJoCo model, or if readings could show no parameter.

        Parameters that only pictures show are left as they are, even if there is a camera.
        """
        simulator = context.simulator
        if not isinstance(simulator, Simulator):
            raise InputError("joint readings need a MuJoCo model")
        shown = [p.name for p in simulator.space if p.is_appearance]
        if len(shown) == len(simulator.space):
            raise InputError(f"{shown[0]} shows in pictures only, and no camera is looked at")
        self.context, self._simulator = context, simulator
        self._precision, self._horizons = precision, Horizons()
        self.first = self.distribution = context.first
        self._stop_reason = ""
        # Seconds of all derivatives of whole episodes, as descents and as the end take them, once
        # measured
        self._derived_s = self._judged_s = 0.0

    @property
    def stop_reason(self) -> str:
        return self._stop_reason

    def check(self, real: list[Trajectory], names: Sequence[str] = ()) -> None:
        """Raises InputError if there are no trajectories, or too short ones."""
        lengths = [len(trajectory) for trajectory in real]
        if (steps := min(lengths, default=0)) < FEWEST_STEPS:
            got = (
                f"{episode_in_words(names, lengths.index(steps))} has {steps}"
                if real
                else "got none"
            )
            raise InputError(f"episodes must last at least {FEWEST_STEPS} steps; {got}")

    def measure_time(self, real: list[Trajectory]) -> TimeNeeded:
        """The smallest sound round derives once at each horizon, and twice in whole episodes."""
        readings, loop = self.look_at(real)
        unit, method = self._begin(loop), self._method(loop)
        stretches = loop.cut(readings, unit)
        began_s, touches = time.monotonic(), loop.touches(stretches, unit)
        if not loop.may_touch:  # else it was played for that
            loop.play(stretches, stretches.states[None], unit[None])
        once_s, steps = time.monotonic() - began_s, sum(map(len, real))
        self._derived_s = method.num_worlds(touches) * once_s
        self._judged_s = (method.num_worlds(True) + MOST_WORLDS) * once_s
        horizons, step_s = self._horizons, self._simulator.step_s
        grown = sum(h.share(steps, step_s) for h in horizons.growing)
        least_s = (grown + 2) * self._derived_s
        searched = _WHOLE_SEARCH_TIME + horizons.derivatives(steps, step_s, self._may_be_late)
        checked = _CHECK_TIME * min(1.0, MOST_REPLAYED / len(real))
        return TimeNeeded(
            least_s,
            max(least_s, searched * self._derived_s),
            checked * self._derived_s,
            slow_steps(1.0, once_s / steps),
        )

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        """Fit; another round may tell more only if time was short."""
        fit = self.fit(real, budget)
        self.distribution = fit.distribution
        self._stop_reason = "" if fit.lacked_time else self._why_over(fit)
        rms = zip(self.context.observation.reading_labels, fit.noise, strict=True)
        return Round(fit.estimate, self._events(), {f"rms/{n}": float(value) for n, value in rms})

    def _why_over(self, fit: ReadingsResult) -> str:
        """Of a search that had the time for all its fits."""
        precision = self._precision
        is_known = is_precise(half_widths(fit.estimate, self.first), precision)
        if precision and is_known and fit.found.is_sure:
            return f"every parameter is known to {100 * precision:g} %"
        return "another round would tell hardly more"

    def fit(self, real: list[Trajectory], budget: Budget) -> ReadingsResult:
        """Fit, from what the last round found if there was one, and judge."""
        if not (budget.is_endless or self._derived_s):
            self.measure_time(real)
        readings, loop = self.look_at(real)
        method = self._method(loop)
        found, latency = self._find(method, readings, budget)
        budget.report("judging how sure that is", 0.9)
        judged, step_s = method.judge(found.best, budget), self._simulator.step_s
        seen = self.context.observation
        unmeasured = Unmeasured(loop.unseen, loop.left_out)
        return conclude(judged, found, self.first, seen, latency, step_s, unmeasured)

    def _find(
        self, method: OutputErrorMethod, readings: Readings, budget: Budget
    ) -> tuple[BestDescent, Latency]:
        """The best of several fits, and the latency of actions."""
        space, step_s, seed = self.first.space, self._simulator.step_s, self.context.seed
        begin, num = method.prior, len(space)
        low, high = (  # what is not searched stays: what pictures show, and a lateness
            np.append(np.where(space.is_appearance, begin[:num], space.to_unit(end)), begin[num:])
            for end in (self.first.low, self.first.high)
        )
        fits = ReadingsDescents(method, readings, step_s, (low, high), self._horizons, seed)
        guesses, latency = fits.begin(begin), Latency()
        if self._may_be_late:
            part = budget.part(budget.seconds_left / 4, (0.0, 0.1))
            guesses[0], latency = fits.find_latency(guesses[0], part)
        part = budget.part(budget.seconds_left / 3, (0.1, 0.4))
        ended = fits.grow(guesses, part, latency.steps)
        left_s = budget.seconds_left  # may be infinite, which allows no difference of two shares
        searching_s = min((1 - _JUDGING_SHARE) * left_s, left_s - _JUDGING_TIME * self._judged_s)
        part = budget.part(searching_s, (0.4, 0.9))
        longest = longest_latency(readings, step_s)
        whole = WholeFits(method, readings, low < high, self._horizons, longest, seed)
        return whole.fit_until_two_agree(ended, latency, part)

    def _method(self, loop: OpenLoopReplay) -> OutputErrorMethod:
        return OutputErrorMethod(loop, finds_offset(loop.sensors), self._begin(loop))

    def _begin(self, loop: OpenLoopReplay) -> np.ndarray:
        """(N,) first guess in unit coordinates, with a lateness of 0 if that is unknown.

        In a round after another one, which was short of time, that is what it found.
        """
        on_time = [] if loop.lateness is None else [late_unit(0.0)]
        return np.append(self.first.space.to_unit(self.distribution.mean), on_time)

    @property
    def _may_be_late(self) -> bool:
        """Whether actions or readings may be."""
        return self.context.observation.unknown_latency_steps(self._simulator) > 0

    def look_at(self, real: list[Trajectory]) -> tuple[Readings, OpenLoopReplay]:
        """Readings of these episodes, and what replays them."""
        seen = self.context.observation
        readings = Readings.of(real, seen.sensors)
        loop = recorded_loop(self._simulator, seen, self.context.start, readings)
        loop = loop.with_lateness() if self._may_be_late else loop
        return readings, where_starts_show(loop, readings, self._begin(loop))

    def _events(self) -> list[Event]:
        why = "joint readings"
        ends = zip(
            self.first.space.names, self.distribution.low, self.distribution.high, strict=True
        )
        return [Event("narrowed", name, float(low), float(high), why) for name, low, high in ends]

    def state(self) -> dict[str, Any]:
        return {"stop_reason": self._stop_reason, "distribution": self.distribution.state()}

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Only the result is kept: a round takes a minute or two."""
        self._stop_reason = state["stop_reason"]
        self.distribution = self.distribution.with_state(state["distribution"])
