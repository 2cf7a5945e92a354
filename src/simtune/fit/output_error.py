"""Output error: the simulator replays whole episodes, until its sensors would read what was read.

The prediction is never corrected by later readings (Ljung 1999, System Identification, Sec. 3.2
and 7.2), so what is minimised is what open-loop replay is judged by. Over parameters θ, offsets b
of the sensors and the starts x_w of W stretches it is

    Σ_w Σ_t Σ_d ρ(r_wtd / σ_d) + ½ Σ_w ‖x_w ⊖ x̄_w‖²_S + ½ ‖θ − θ̄‖²_Π
    r_wtd = h_d(x_w(t; θ)) + b_d − y_wtd

with Huber's ρ, starts x̄_w from the readings themselves, and a weak prior Π around the first guess.
σ_d is what is left of each reading, and found along: a joint counts by how well the simulator can
explain it. Gauss-Newton with Levenberg's damping; starts go out by the Schur complement.

No simulator is a robot, so what is left is no white noise: it goes on for a second. Each residual
counts as 1/τ_d of a measurement, with τ_d its integrated autocorrelation time.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit.combine import step_within_bounds
from simtune.fit.differences import differentiate
from simtune.fit.normal_equations import NormalEquations, jackknife, normal_equations
from simtune.fit.open_loop import OpenLoop
from simtune.fit.readings import Readings, Stretches
from simtune.fit.residuals import HUBER, correlation_times, spread
from simtune.fit.slopes import Groups, Slopes

_PRIOR_STD = 0.3  # of parameters, in unit coordinates: nothing is known within a factor of 3
_LARGEST_STEP = 0.12
_FIRST_DAMPING = 1e-2
_DAMPING = (1e-4, 1e6)
_TRIED = 7  # steps, each with more damping, before it is over
_ENOUGH = 1e-4  # share of the cost, that a step has to gain for another one to follow
_FEWEST = 2.0  # effective observations of a reading


class ReplayStage(NamedTuple):
    steps: int  # of a stretch; 0: all of an episode
    iterations: int
    at_most: int  # stretches


@dataclass(frozen=True)
class OutputErrorFit:
    """What was found; P parameters, D readings."""

    unit: np.ndarray  # (N,) parameters in unit coordinates, those not fitted as they were
    covariance: np.ndarray  # (P, P) in unit coordinates
    offsets: np.ndarray  # (D,) measured − simulated
    noise: np.ndarray  # (D,) root mean square of what is left
    cost: float  # mean logarithm of that, over all that was read: lower is better
    correlation_steps: np.ndarray  # (D,) how long what is left goes on
    start: np.ndarray  # (S,) full state in which the first stretch begins


@dataclass(frozen=True)
class _Point:
    unit: np.ndarray  # (N,)
    offsets: np.ndarray  # (D,)
    states: np.ndarray  # (W, nq + nv)
    shift: np.ndarray  # (W, S) of the starts, in terms of what was unknown of them


class OutputError:
    """Fits one simulator to readings."""

    def __init__(self, loop: OpenLoop, finds_offset: np.ndarray, prior: np.ndarray):
        """`finds_offset`: (D,) bool; `prior`: (N,) first guess, in unit coordinates."""
        self._loop, self._finds_offset, self._prior = loop, finds_offset, prior
        self._fitted = loop.fitted

    def fit(
        self,
        readings: Readings,
        unit: np.ndarray,
        offsets: np.ndarray,
        stage: ReplayStage,
        budget: Budget,
    ) -> OutputErrorFit:
        """From (N,) parameters and (D,) offsets; `budget` ends it early."""
        steps = stage.steps or readings.actions.shape[1]
        stretches = self._loop.cut(readings, unit, offsets, steps, stage.at_most)
        shift = np.zeros((len(stretches.states), len(self._loop.start_tangents)))
        begin = _Point(unit, offsets, stretches.states, shift)
        return self._conclude(stretches, *self._descend(stretches, begin, stage.iterations, budget))

    def _descend(
        self, stretches: Stretches, point: _Point, iterations: int, budget: Budget
    ) -> tuple[_Point, Slopes]:
        """The lowest point found, and all derivatives there.

        They are first taken one by one, then of many unknowns at once (`Groups`), until that gains
        nothing; then one by one again, to see whether it is over.
        """
        loop, damping, groups = self._loop, _FIRST_DAMPING, None
        noise = spread(self._residuals(stretches, point, self._predict(stretches, point)))
        start_std = loop.start_std(noise)
        iteration = 0
        while True:
            slopes = differentiate(loop, stretches, point.states, point.unit, start_std, groups)
            if groups is None and (iteration >= iterations or budget.is_over):
                return point, slopes
            residuals = self._residuals(stretches, point, slopes.predicted)
            equations = normal_equations(slopes, residuals, noise, self._finds_offset, point.shift)
            before, gain, tried = self._cost(point, residuals, noise), 0.0, point
            for _ in range(_TRIED):
                tried = self._step(point, equations, damping, start_std, stretches)
                residuals = self._residuals(stretches, tried, self._predict(stretches, tried))
                gain = before - self._cost(tried, residuals, noise)
                damping = float(np.clip(damping * (0.2 if gain > 0 else 8), *_DAMPING))
                if gain > 0:
                    break
            is_over = gain < _ENOUGH * before
            if is_over and groups is None:
                return point, slopes
            if gain > 0:
                point, noise = tried, spread(residuals)
            iteration += 1
            is_last = is_over or iteration >= iterations or budget.is_over
            groups = None if is_last else groups or Groups.of(slopes, noise)

    def _predict(self, stretches: Stretches, point: _Point) -> np.ndarray:
        return self._loop.play(stretches, point.states[None], point.unit[None])[0][0]

    def _residuals(self, stretches: Stretches, point: _Point, predicted: np.ndarray) -> np.ndarray:
        """(W, K + 1, D), NaN where nothing was read."""
        return predicted + point.offsets - stretches.values

    def _cost(self, point: _Point, residuals: np.ndarray, noise: np.ndarray) -> float:
        size = np.abs(np.nan_to_num(residuals / noise))
        huber = np.where(size < HUBER, size**2 / 2, HUBER * (size - HUBER / 2))
        away = (point.unit - self._prior)[self._fitted] / _PRIOR_STD
        return float(huber.sum() + np.square(point.shift).sum() / 2 + np.square(away).sum() / 2)

    def _with_prior(
        self, equations: NormalEquations, unit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information and slope of all stretches and, of the parameters, which come first, Π."""
        information, slope = equations.information.sum(0), equations.slope.sum(0)
        its = np.arange(len(self._fitted))
        information[its, its] += _PRIOR_STD**-2
        slope[its] += (unit - self._prior)[self._fitted] / _PRIOR_STD**2
        return information, slope

    def _step(
        self,
        point: _Point,
        equations: NormalEquations,
        damping: float,
        start_std: np.ndarray,
        stretches: Stretches,
    ) -> _Point:
        num = len(self._fitted)
        information, slope = self._with_prior(equations, point.unit)
        damped = information + damping * np.diag(np.diag(information))
        unit = point.unit[self._fitted]
        change = step_within_bounds(damped, slope, unit, _LARGEST_STEP)
        new = point.unit.copy()
        new[self._fitted] = np.clip(unit + change[:num], 0, 1)
        offsets = point.offsets.copy()
        offsets[self._finds_offset] += change[num:]
        gradient = equations.gradient + equations.cross @ change
        shift = point.shift - np.linalg.solve(equations.hessian, gradient[..., None])[..., 0]
        states = self._loop.moved(stretches.states, shift, start_std)
        return replace(point, unit=new, offsets=offsets, states=states, shift=shift)

    def _conclude(self, stretches: Stretches, point: _Point, slopes: Slopes) -> OutputErrorFit:
        """How sure the parameters are, as if each residual counted as 1/τ of a measurement."""
        loop, num = self._loop, len(self._fitted)
        residuals = self._residuals(stretches, point, slopes.predicted)
        noise, times = spread(residuals), correlation_times(residuals)
        count = np.maximum(np.isfinite(residuals).sum((0, 1)) / times, _FEWEST)
        # Each column pays for its own offset and for its share of the parameters
        spent = self._finds_offset + num / len(noise)
        unsure = np.sqrt(times * count / np.maximum(count - spent, count / 4))
        equations = normal_equations(
            slopes, residuals, noise * unsure, self._finds_offset, point.shift
        )
        information, _ = self._with_prior(equations, point.unit)
        covariance = np.linalg.inv(information)
        scatter = jackknife(equations, information)[:num]
        std = np.sqrt(np.diag(covariance))[:num]
        wider = np.maximum(scatter / std, 1.0)
        _, full_states = loop.play(stretches, point.states[None], point.unit[None])
        return OutputErrorFit(
            point.unit,
            covariance[:num, :num] * np.outer(wider, wider),
            point.offsets,
            noise,
            float(np.average(np.log(noise), weights=np.isfinite(residuals).sum((0, 1)))),
            times,
            full_states[0, 0],
        )
