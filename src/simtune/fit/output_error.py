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
from scipy.special import ndtri, stdtrit

from simtune.budget import Budget
from simtune.fit.combine import step_within_bounds
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
            slopes = loop.differentiate(stretches, point.states, point.unit, start_std, groups)
            if groups is None and (iteration >= iterations or budget.is_over):
                return point, slopes
            equations = self._linearize(stretches, point, slopes, noise)
            before, gain, tried = self._cost(stretches, point, slopes.predicted, noise), 0.0, point
            predicted = slopes.predicted
            for _ in range(_TRIED):
                tried = self._step(point, equations, damping, start_std, stretches)
                predicted = self._predict(stretches, tried)
                gain = before - self._cost(stretches, tried, predicted, noise)
                damping = float(np.clip(damping * (0.2 if gain > 0 else 8), *_DAMPING))
                if gain > 0:
                    break
            is_over = gain < _ENOUGH * before
            if is_over and groups is None:
                return point, slopes
            if gain > 0:
                point = tried
                noise = spread(self._residuals(stretches, point, predicted))
            iteration += 1
            is_last = is_over or iteration >= iterations or budget.is_over
            groups = None if is_last else groups or Groups.of(slopes, noise)

    def _predict(self, stretches: Stretches, point: _Point) -> np.ndarray:
        return self._loop.play(stretches, point.states[None], point.unit[None])[0][0]

    def _residuals(self, stretches: Stretches, point: _Point, predicted: np.ndarray) -> np.ndarray:
        """(W, K + 1, D), NaN where nothing was read."""
        return predicted + point.offsets - stretches.values

    def _cost(
        self, stretches: Stretches, point: _Point, predicted: np.ndarray, noise: np.ndarray
    ) -> float:
        size = np.abs(np.nan_to_num(self._residuals(stretches, point, predicted) / noise))
        huber = np.where(size < HUBER, size**2 / 2, HUBER * (size - HUBER / 2))
        away = (point.unit - self._prior)[self._fitted] / _PRIOR_STD
        return float(huber.sum() + np.square(point.shift).sum() / 2 + np.square(away).sum() / 2)

    def _linearize(
        self, stretches: Stretches, point: _Point, slopes: Slopes, noise: np.ndarray
    ) -> "_Equations":
        """Normal equations of parameters, offsets and starts, the starts taken out.

        With A_x, A_θ derivatives of r / σ by starts and by (θ, b), V the weights of Huber's ρ:

            H = A_x V A_xᵀ + 1    C = A_x V A_θᵀ    B = A_θ V A_θᵀ
        """
        residuals = self._residuals(stretches, point, slopes.predicted) / noise
        known = np.isfinite(residuals)
        residuals = np.nan_to_num(residuals)
        weights = known * np.minimum(1, HUBER / np.maximum(np.abs(residuals), 1e-12))
        num = len(residuals)
        r, w = residuals.reshape(num, -1), weights.reshape(num, -1)
        by_start = (slopes.by_start / noise).reshape(num, -1, r.shape[1])
        by_parameter = (slopes.by_parameter / noise).reshape(num, -1, r.shape[1])
        ones = np.zeros((len(noise), *residuals.shape[1:]))
        ones[np.arange(len(noise)), :, np.arange(len(noise))] = 1 / noise[:, None]
        by_offset = np.broadcast_to(ones.reshape(1, len(noise), -1), (num, len(noise), r.shape[1]))
        by_shared = np.concatenate([by_parameter, by_offset[:, self._finds_offset]], 1)
        weighted = by_start * w[:, None]
        hessian = weighted @ by_start.swapaxes(1, 2) + np.eye(by_start.shape[1])
        cross = weighted @ by_shared.swapaxes(1, 2)
        gradient = (weighted @ r[..., None])[..., 0] + point.shift
        follow = np.linalg.solve(hessian, cross)
        shared = by_shared * w[:, None]
        information = shared @ by_shared.swapaxes(1, 2) - cross.swapaxes(1, 2) @ follow
        slope = (shared @ r[..., None])[..., 0] - np.einsum("wsp,ws->wp", follow, gradient)
        return _Equations(hessian, cross, gradient, information, slope)

    def _with_prior(
        self, information: np.ndarray, slope: np.ndarray, unit: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """That of the parameters, which come first, added."""
        num = len(self._fitted)
        information, slope = information.copy(), slope.copy()
        information[np.arange(num), np.arange(num)] += _PRIOR_STD**-2
        slope[:num] += (unit - self._prior)[self._fitted] / _PRIOR_STD**2
        return information, slope

    def _step(
        self,
        point: _Point,
        equations: "_Equations",
        damping: float,
        start_std: np.ndarray,
        stretches: Stretches,
    ) -> _Point:
        num = len(self._fitted)
        information, slope = self._with_prior(
            equations.information.sum(0), equations.slope.sum(0), point.unit
        )
        damped = information + damping * np.diag(np.diag(information))
        unit = point.unit[self._fitted]
        change = step_within_bounds(damped, slope, unit, _LARGEST_STEP)
        new = point.unit.copy()
        new[self._fitted] = np.clip(unit + change[:num], 0, 1)
        offsets = point.offsets.copy()
        offsets[self._finds_offset] += change[num:]
        gradient = equations.gradient + equations.cross @ change
        shift = point.shift - np.linalg.solve(equations.hessian, gradient[..., None])[..., 0]
        tangents = (shift * start_std) @ self._loop.start_tangents
        states = self._loop.physics.space.move(stretches.states, tangents)
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
        equations = self._linearize(stretches, point, slopes, noise * unsure)
        information, _ = self._with_prior(
            equations.information.sum(0), equations.slope.sum(0), point.unit
        )
        covariance = np.linalg.inv(information)
        scatter = _jackknife(equations, information)[:num]
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


class _Equations(NamedTuple):
    hessian: np.ndarray  # (W, S, S)
    cross: np.ndarray  # (W, S, P + offsets)
    gradient: np.ndarray  # (W, S)
    information: np.ndarray  # (W, P + offsets, P + offsets)
    slope: np.ndarray  # (W, P + offsets)


def _jackknife(equations: _Equations, information: np.ndarray) -> np.ndarray:
    """(P + offsets,) standard deviations, by leaving out each stretch in turn (Tukey 1958).

    One step of Newton from the solution of all: θ₍₋w₎ − θ = (I − I_w)⁻¹ g_w. It sees what differs
    from episode to episode, such as what the hand carries. Of few it is unsure itself, so 90 %
    intervals are as wide as Student's.
    """
    left = information - equations.information  # (W, P, P)
    moved = np.linalg.solve(left, equations.slope[..., None])[..., 0]
    num = len(moved)
    unsure = stdtrit(max(num - 1, 1), 0.95) / ndtri(0.95)
    return unsure * np.sqrt((num - 1) / num * np.square(moved - moved.mean(0)).sum(0))
