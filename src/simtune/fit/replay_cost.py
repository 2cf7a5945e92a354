"""The objective of `fit.output_error`: residuals, cost, and a step that lowers it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simtune.fit.combine import step_within_bounds
from simtune.fit.differences import Where
from simtune.fit.normal_equations import NormalEquations, normal_equations
from simtune.fit.open_loop import OpenLoop
from simtune.fit.readings import Stretches
from simtune.fit.residuals import HUBER
from simtune.fit.slopes import Slopes

PRIOR_STD = 0.3  # of parameters, in unit coordinates: weak, a factor of 3 or so
_LARGEST_STEP = 0.12


class Guess(NamedTuple):
    """Start of a descent."""

    unit: np.ndarray  # (N,) in unit coordinates
    offsets: np.ndarray  # (D,) measured − simulated


class Point(NamedTuple):
    """Parameters, offsets and the stretches' initial states."""

    unit: np.ndarray  # (N,)
    offsets: np.ndarray  # (D,)
    states: np.ndarray  # (W, nq + nv)
    shift: np.ndarray  # (W, S) of the initial states, in units of `start_std`


@dataclass(frozen=True)
class ReplayCost:
    """Of W stretches, D readings and S unknowns of each initial state."""

    loop: OpenLoop
    stretches: Stretches
    start_std: np.ndarray  # (S,) prior std of an initial state
    finds_offset: np.ndarray  # (D,) bool
    prior: np.ndarray  # (N,) first guess, in unit coordinates

    def begin(self, guess: Guess) -> Point:
        """With initial states from the readings."""
        no_shift = np.zeros((len(self.stretches.states), len(self.start_std)))
        return Point(guess.unit, guess.offsets, self.stretches.states, no_shift)

    def where(self, point: Point) -> Where:
        return Where(self.stretches, point.states, point.unit, self.start_std)

    def play(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """(W, K + 1, D) predictions without offsets, and (W, S) first full states."""
        predicted, full_states = self.loop.play(
            self.stretches, point.states[None], point.unit[None]
        )
        return predicted[0], full_states[0]

    def residuals(self, point: Point, predicted: np.ndarray) -> np.ndarray:
        """(W, K + 1, D), NaN where nothing was read."""
        return predicted + point.offsets - self.stretches.values

    def cost(self, point: Point, residuals: np.ndarray, noise: np.ndarray) -> float:
        size = np.abs(np.nan_to_num(residuals / noise))
        huber = np.where(size < HUBER, size**2 / 2, HUBER * (size - HUBER / 2))
        away = (point.unit - self.prior)[self.loop.fitted] / PRIOR_STD
        return float(huber.sum() + np.square(point.shift).sum() / 2 + np.square(away).sum() / 2)

    def equations(self, point: Point, slopes: Slopes, noise: np.ndarray) -> NormalEquations:
        residuals = self.residuals(point, slopes.predicted)
        return normal_equations(slopes, residuals, noise, self.finds_offset, point.shift)

    def with_prior(
        self, equations: NormalEquations, unit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information and slope of all stretches, and of the prior Π of parameters (the first)."""
        information, slope = equations.information.sum(0), equations.slope.sum(0)
        own = np.arange(len(self.loop.fitted))
        information[own, own] += PRIOR_STD**-2
        slope[own] += (unit - self.prior)[self.loop.fitted] / PRIOR_STD**2
        return information, slope

    def step(self, point: Point, equations: NormalEquations, damping: float) -> Point:
        """Result of a Newton step with Levenberg's damping."""
        fitted, num = self.loop.fitted, len(self.loop.fitted)
        information, slope = self.with_prior(equations, point.unit)
        damped = information + damping * np.diag(np.diag(information))
        change = step_within_bounds(damped, slope, point.unit[fitted], _LARGEST_STEP)
        unit, offsets = point.unit.copy(), point.offsets.copy()
        unit[fitted] = np.clip(unit[fitted] + change[:num], 0, 1)
        offsets[self.finds_offset] += change[num:]
        gradient = equations.gradient + equations.cross @ change
        shift = point.shift - np.linalg.solve(equations.hessian, gradient[..., None])[..., 0]
        return Point(
            unit, offsets, self.loop.moved(self.stretches.states, shift, self.start_std), shift
        )
