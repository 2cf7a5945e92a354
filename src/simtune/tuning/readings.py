"""Search by joint readings alone: no camera, nothing to learn to see.

What takes networks with video is done by the readings themselves: they say where each episode
begins. A single round is all there is:

    far      short stretches, from several first guesses: nearly linear, so nothing gets stuck
    late     by how many steps actions take effect late, if no parameter says so
    whole    open-loop replay of whole episodes, which is what has to be right
    again    from other starts, until two end at what is best: contacts and limits make it rough
    judge    how sure that is, and what the model cannot explain
"""

import math
import time
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import torch

from simtune.budget import Budget
from simtune.errors import InputError
from simtune.fit import OpenLoop, OutputError, OutputErrorFit, Readings, ReplayStage
from simtune.fit.result import block_correlation
from simtune.fit.uncertainty import latency_warning, tell_apart
from simtune.observation import declared_noise, finds_offset, joints_of
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.range_update import RangeUpdateConfig, normal_curves, read_curves
from simtune.tuning.rounds import half_widths, is_precise
from simtune.tuning.search import Estimate, Event, Round, SearchContext, at_most_weak

_FEWEST_STEPS = 8
_LONGEST_DELAY_S = 0.5
_CLEARLY_BETTER = 0.02  # share of what is left: a fit, or a delay, that explains less is as good
_SEEN_WIDTH = 6.0  # standard deviations to either side, within which curves are drawn
_LEAST_STD = 1e-3  # in unit coordinates
_UNKNOWN_STD = 1.0  # of what shows in pictures only
_AT_BOUND = 1e-3
_SIDESTEPS = (0.03, 0.1)  # in unit coordinates, from which a fit should come back
_TOGETHER = 2  # starts, in which all parameters are higher or lower
_NOT_FOUND_TWICE = (
    "Fits to whole episodes ended at no answer twice ({} tried, from as many starts), so how sure "
    "the best of them is cannot be said, and nothing is called identified. Leave parameters out "
    "that go with others, give better first guesses, or more minutes."
)

_FAR_MORE = 4.0  # times the noise that a sensor declares
_UNEXPLAINED = (
    "The simulator leaves {} off by over four times the noise that the tuning file declares: the "
    "model lacks something, or the search ended beside the truth. Intervals count what is left, "
    "not why."
)


@dataclass(frozen=True, kw_only=True)
class ReadingsConfig:
    """How long and how often is looked."""

    stretch_s: float = 1.0
    stretches: int = 24  # of that length; more would hardly tell more at first
    num_starts: int = 3  # the first guess, and others around it
    far_iterations: int = 8
    late_iterations: int = 3
    whole_iterations: int = 15
    most_fits: int = 8  # to whole episodes
    precision: float = 0.01
    range_update: RangeUpdateConfig = field(default_factory=RangeUpdateConfig)


class Found(NamedTuple):
    best: OutputErrorFit
    apart: np.ndarray  # (P,) half of how far away others end that are as good
    is_sure: bool  # another one is as good
    num_fits: int


class ReadingsSearch:
    """A `tuning.search.Search` that looks at readings only."""

    def __init__(self, context: SearchContext, config: ReadingsConfig | None = None):
        """Raises InputError where there is no model, or nothing that readings could tell.

        What shows in pictures only stays as it is where there is a camera at which nobody looks.
        """
        simulator = context.simulator
        if not isinstance(simulator, Simulator):
            raise InputError("joint readings need a MuJoCo model")
        shown = [p.name for p in simulator.space if p.is_appearance]
        if len(shown) == len(simulator.space):
            raise InputError(f"{shown[0]} shows in pictures only, and no camera is looked at")
        self.config, self._context, self._simulator = config or ReadingsConfig(), context, simulator
        self.first = self.distribution = Distribution.first(simulator.space, context.start)
        self.stop_reason = ""

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError where there are no trajectories, or too short ones."""
        if (steps := min((len(t) for t in real), default=0)) < _FEWEST_STEPS:
            got = f"got one of {steps}" if real else "got none"
            raise InputError(f"episodes must last at least {_FEWEST_STEPS} steps, {got}")

    def needed_s(self, real: list[Trajectory]) -> tuple[float, float]:
        """Seconds: few iterations over whole episodes, and all."""
        readings, loop = self._look_at(real)
        unit = self._simulator.space.to_unit(self._context.start)
        stretches = loop.cut(readings, unit, np.zeros(loop.num_readings), 10**9, 10**9)
        began_s = time.monotonic()
        loop.play(stretches, stretches.states[None], unit[None])
        once_s = time.monotonic() - began_s
        each_s = (1 + len(loop.fitted) + len(loop.start_tangents)) * once_s
        return 2 * each_s, (self.config.whole_iterations + self.config.far_iterations) * each_s

    def run_round(self, real: list[Trajectory], budget: Budget) -> Round:
        """Fit, and judge."""
        readings, loop = self._look_at(real)
        first_guess = self._simulator.space.to_unit(self._context.start)
        fit = OutputError(loop, finds_offset(loop.sensors), first_guess)
        budget.report("fitting short stretches", 0.05)
        far = self._from_afar(fit, readings, first_guess, budget.part(budget.seconds_left / 3))
        late = self._how_late(fit, readings, far, budget.part(budget.seconds_left / 3))
        budget.report("replaying whole episodes", 0.4)
        found = self._until_found_twice(fit, readings.delayed(late), far, budget)
        estimate = self._conclude(found, late)
        precision = self.config.precision
        is_known = precision and is_precise(half_widths(estimate, self.first), precision)
        known = f"every parameter is known to {100 * precision:g} %"
        self.stop_reason = known if is_known else "another round would tell hardly more"
        return Round(estimate, self._events(), self._metrics(found.best))

    def _look_at(self, real: list[Trajectory]) -> tuple[Readings, OpenLoop]:
        loop = OpenLoop.of(self._simulator, self._context.observation, self._context.start)
        return Readings.of(real, loop.sensors), loop

    def _from_afar(
        self, fit: OutputError, readings: Readings, first_guess: np.ndarray, budget: Budget
    ) -> OutputErrorFit:
        """The best from several first guesses, by short stretches."""
        config, rng = self.config, np.random.default_rng(self._context.seed)
        stage = self._stretch(config.far_iterations)
        low, high = (self.first.space.to_unit(end) for end in (self.first.low, self.first.high))
        found: list[OutputErrorFit] = []
        for number in range(config.num_starts):
            begin = rng.uniform(low, high) if number else first_guess
            begin = np.where(self.first.space.is_appearance, first_guess, begin)
            zero = np.zeros(readings.values.shape[-1])
            found.append(fit.fit(readings, begin, zero, stage, budget))
            if budget.is_over:
                break
        return min(found, key=lambda its: its.cost)

    def _how_late(
        self, fit: OutputError, readings: Readings, far: OutputErrorFit, budget: Budget
    ) -> int:
        """Steps by which actions take effect late, where that explains clearly more."""
        simulator, best, steps = self._simulator, far, 0
        if simulator.space.is_delay.any() or not self._context.observation.max_latency_steps:
            return 0
        longest = math.ceil(_LONGEST_DELAY_S / simulator.step_s)
        for number in range(1, longest + 1):
            budget.report("looking for a delay", number / longest)
            stage = self._stretch(self.config.late_iterations)
            late = readings.delayed(number)
            its = fit.fit(late, best.unit, best.offsets, stage, budget)
            if its.cost < best.cost - _CLEARLY_BETTER:
                best, steps = its, number
            elif number > steps + 2 or budget.is_over:
                break
        return steps

    def _until_found_twice(
        self, fit: OutputError, readings: Readings, far: OutputErrorFit, budget: Budget
    ) -> Found:
        """Fits to whole episodes, from one start after the other, until two are the best."""
        stage = ReplayStage(0, self.config.whole_iterations, 10**9)
        rng, begun = np.random.default_rng((self._context.seed, 1)), budget.seconds_left
        fits = [fit.fit(readings, far.unit, far.offsets, stage, budget)]
        took_s, moving = begun - budget.seconds_left, ~self.first.space.is_appearance
        best = fits[0]
        while len(fits) < self.config.most_fits:
            if _is_twice(fits) and not self._unexplained(best):
                break
            if not (budget.is_endless or budget.seconds_left > took_s):
                break
            budget.report("replaying whole episodes again", 0.5 + len(fits) / 20)
            away = rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(*np.log(_SIDESTEPS)))
            # The first two together, as what is far off mostly is; later ones each by itself
            step = away if len(fits) <= _TOGETHER else away * rng.normal(size=len(moving))
            begin = np.clip(best.unit + step * moving, 0, 1)
            fits.append(fit.fit(readings, begin, best.offsets, stage, budget))
            best = min(fits, key=lambda its: its.cost)
        as_good = [its.unit for its in fits if its.cost < best.cost + _CLEARLY_BETTER]
        apart = np.abs(as_good - best.unit).max(0)[moving] / 2
        return Found(best, apart, _is_twice(fits), len(fits))

    def _unexplained(self, found: OutputErrorFit) -> list[str]:
        """Readings that are off by far more than the noise that was declared for them."""
        noise = declared_noise(joints_of(self._context.observation.sensors))
        off = found.noise > _FAR_MORE * noise
        return [label for label, its in zip(self.labels, off, strict=True) if its]

    def _stretch(self, iterations: int) -> ReplayStage:
        steps = max(_FEWEST_STEPS, round(self.config.stretch_s / self._simulator.step_s))
        return ReplayStage(steps, iterations, self.config.stretches)

    def _conclude(self, found: Found, late: int) -> Estimate:
        best, space, config = found.best, self.first.space, self.config.range_update
        fitted = np.flatnonzero(~space.is_appearance)
        std = np.full(len(space), _UNKNOWN_STD)
        std[fitted] = np.hypot(np.sqrt(np.diag(best.covariance)), found.apart)
        discrepancy = self._context.observation.discrepancy_std(space.is_appearance)
        std = np.maximum(np.hypot(std, discrepancy), _LEAST_STD)
        ends = (best.unit - _SEEN_WIDTH * std, best.unit + _SEEN_WIDTH * std)
        low, high = (space.from_unit(np.clip(end, 0, 1)) for end in ends)
        mean = space.from_unit(best.unit)
        self.distribution = self.first.with_interval(mean, low, high)
        width = space.to_unit(high) - space.to_unit(low)
        curves = normal_curves(self.distribution.to_range_unit(mean), std / width)
        correlation = block_correlation(len(std), [(fitted, best.covariance)])
        estimate = read_curves(curves, self.distribution, self.first, config)
        return replace(
            estimate,
            mean=mean,
            verdict=estimate.verdict if found.is_sure else at_most_weak(estimate.verdict),
            correlation=correlation,
            correlations=tell_apart(correlation, space.names),
            warnings=self._warnings(found, late),
            start=best.start.tolist(),
            latency_steps=late,
            offsets=dict(zip(self.labels, best.offsets.tolist(), strict=True)),
        )

    @property
    def labels(self) -> tuple[str, ...]:
        """(D,) what each reading is called."""
        return self._context.observation.reading_labels

    def _warnings(self, found: Found, late: int) -> list[str]:
        space = self.first.space
        warnings = latency_warning(late)
        if not found.is_sure:
            warnings.append(_NOT_FOUND_TWICE.format(found.num_fits))
        if labels := self._unexplained(found.best):
            warnings.append(_UNEXPLAINED.format(", ".join(labels)))
        for parameter, unit in zip(space, found.best.unit, strict=True):
            if min(unit, 1 - unit) < _AT_BOUND and not parameter.is_appearance:
                warnings.append(
                    f"{parameter.name} ended at a bound of its range: the truth may lie beyond, "
                    "or the model lacks something; give it a wider low and high to see"
                )
        return warnings

    def _events(self) -> list[Event]:
        why = "joint readings"
        ends = zip(
            self.first.space.names, self.distribution.low, self.distribution.high, strict=True
        )
        return [Event("narrowed", name, float(low), float(high), why) for name, low, high in ends]

    def _metrics(self, found: OutputErrorFit) -> dict[str, float]:
        return {f"rms/{n}": float(v) for n, v in zip(self.labels, found.noise, strict=True)}

    def tensors(self) -> dict[str, torch.Tensor]:
        return {}

    def state(self) -> dict[str, Any]:
        return {"stop_reason": self.stop_reason, "distribution": self.distribution.state()}

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Nothing but the result is kept: a round is over in a minute or two."""
        self.stop_reason = state["stop_reason"]
        self.distribution = self.distribution.with_state(state["distribution"])


def _is_twice(fits: list[OutputErrorFit]) -> bool:
    """Whether the two best ones leave as little, nearly."""
    costs = sorted(its.cost for its in fits)
    return len(costs) > 1 and costs[1] < costs[0] + _CLEARLY_BETTER
