"""The objective of `output_error`: residuals, cost, and a step that lowers it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from simtune.fit.combine import step_within_bounds
from simtune.fit.elimination import NormalEquations
from simtune.fit.readings.differences import DifferencePoint
from simtune.fit.readings.normal_equations import by_shared, normal_equations
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.residuals import HUBER, spread
from simtune.fit.readings.segments import Stretches
from simtune.fit.readings.slopes import StretchSlopes
from simtune.observation import assumed_noise

PRIOR_STD = 0.3  # of parameters, in unit coordinates: weak, a factor of 3 or so
_OFFSET_STD = 1.0  # rad or m, of offsets: as good as unknown
_LARGEST_STEP = 0.12
_MAX_RESIDUAL = 1e9  # in units of the noise: its square is taken


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
class ReplayObjective:
    """Of W stretches, D readings and S unknowns of each initial state.

    A guess's `shift` is that of initial states from those that readings give, with the guess's
    offsets and lateness.
    """

    loop: OpenLoopReplay
    stretches: Stretches
    cut_at: Guess  # with whose offsets and lateness the stretches' states were read
    start_std: np.ndarray  # (S,) prior std of an initial state
    finds_offset: np.ndarray  # (D,) bool
    prior: np.ndarray  # (N,) first guess, in unit coordinates
    touches: bool = True  # whether anything does in these stretches

    def begin(self, guess: Guess) -> Point:
        """With initial states from the readings."""
        no_shift = np.zeros((len(self.stretches.states), len(self.start_std)))
        return Point(guess.unit, guess.offsets, self.stretches.states, no_shift)

    @property
    def begins_at_first(self) -> bool:
        """Whether the first stretch begins where the first episode does."""
        begin = self.stretches.begin
        return begin is not None and begin[0] == self.stretches.episode[0] == 0

    def difference_point(self, point: Point) -> DifferencePoint:
        return DifferencePoint(
            self.stretches, point.states, point.unit, self.start_std, self.touches
        )

    def play(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """(W, K + 1, D) predictions without offsets, and (W, S) first full states."""
        predicted, full_states = self.loop.play(
            self.stretches, point.states[None], point.unit[None]
        )
        return predicted[0], full_states[0]

    def residuals(self, point: Point, predicted: np.ndarray) -> np.ndarray:
        """(W, K + 1, D), NaN where nothing was read."""
        return predicted + point.offsets - self.stretches.values

    def noise(self, residuals: np.ndarray) -> np.ndarray:
        """(D,) root mean square of (W, K + 1, D) residuals; the usual noise if nothing is read."""
        return spread(residuals, assumed_noise(self.loop.sensors))

    def cost(self, point: Point, residuals: np.ndarray, noise: np.ndarray) -> float:
        size = np.minimum(np.abs(np.nan_to_num(residuals / noise)), _MAX_RESIDUAL)
        huber = np.where(size < HUBER, size**2 / 2, HUBER * (size - HUBER / 2))
        precision, away = self._prior(point)
        of_prior = (precision * np.square(away)).sum() / 2
        return float(huber.sum() + np.square(point.shift).sum() / 2 + of_prior)

    def _prior(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """(P + offsets,) precisions of the priors of parameters and offsets, and deviations."""
        away = (point.unit - self.prior)[self.loop.fitted], point.offsets[self.finds_offset]
        std = np.repeat([PRIOR_STD, _OFFSET_STD], [len(part) for part in away])
        return std**-2, np.concatenate(away)

    def equations(
        self,
        point: Point,
        slopes: StretchSlopes,
        noise: np.ndarray,
        left_out: np.ndarray | Sequence[int] = (),
    ) -> NormalEquations:
        """`left_out`: indices of rows, as if nothing had been read in them."""
        residuals = self.residuals(point, slopes.predicted)
        residuals[:, np.array(left_out, int)] = np.nan
        shared = by_shared(slopes, self.finds_offset, self._by_shared)
        return normal_equations(slopes.by_start, shared, residuals, noise, point.shift)

    @cached_property
    def _by_shared(self) -> np.ndarray:
        """(W, P + offsets, S) of initial states that readings give, in units of `start_std`."""
        return self.loop.starts_by_shared(self.stretches, self.finds_offset) / self.start_std

    def with_prior(self, equations: NormalEquations, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Information and slope of all stretches, and of the priors of parameters and offsets."""
        information, slope = equations.information.sum(0), equations.shared_gradient.sum(0)
        precision, away = self._prior(point)
        return information + np.diag(precision), slope + precision * away

    def step(self, point: Point, equations: NormalEquations, damping: float) -> Point:
        """Result of a Newton step with Levenberg's damping."""
        fitted, num = self.loop.fitted, len(self.loop.fitted)
        information, slope = self.with_prior(equations, point)
        damped = information + damping * np.diag(np.diag(information))
        change = step_within_bounds(damped, slope, point.unit[fitted], _LARGEST_STEP)
        unit, offsets = point.unit.copy(), point.offsets.copy()
        unit[fitted] = np.clip(unit[fitted] + change[:num], 0, 1)
        offsets[self.finds_offset] += change[num:]
        shift = point.shift + equations.own_step(change)
        return Point(unit, offsets, self._states(unit, offsets, shift), shift)

    def _states(self, unit: np.ndarray, offsets: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """(W, nq + nv) initial states: those that readings give, moved by (W, S) `shift`."""
        moved = (unit - self.cut_at.unit)[self.loop.fitted]
        moved = np.append(moved, (offsets - self.cut_at.offsets)[self.finds_offset])
        given = np.einsum("wps,p->ws", self._by_shared, moved)
        return self.loop.measured.moved(self.stretches.states, given + shift, self.start_std)
