"""Linearises windows around a point: normal equations, with the initial states eliminated.

Derivatives are finite differences; all perturbed worlds run in one batch.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from simtune.fit.elimination import NormalEquations, eliminate
from simtune.fit.lateness import Lateness
from simtune.fit.motion.common_errors import directions
from simtune.fit.motion.shooting_config import Spans
from simtune.fit.motion.windows import Windows
from simtune.fit.physics import Physics, is_lost

_SMALLEST_DELTA = 1e-5  # of a state's unknowns
_RIDGE = 1e-6  # of a Hessian, relative to its diagonal


@dataclass(frozen=True)
class LinearizationPoint:
    """Initial states of W windows, the shared parameters, and the settings of the next step."""

    states: np.ndarray  # (W, nq + nv)
    unit: np.ndarray  # (N,) parameters in unit coordinates; (N + G,) with latenesses
    damping: np.ndarray  # (W,) Levenberg-Marquardt damping of the states' steps
    variance: float  # of the parameters between windows
    step_scale: float = 1.0  # share of a parameter step that is taken
    # (Q,) common errors, see `common_errors`
    common: np.ndarray = field(default_factory=lambda: np.zeros(0))


class WindowSlopes(NamedTuple):
    """Predictions of W windows at a point, and their derivatives."""

    predicted: np.ndarray  # (W, K, D)
    by_state: np.ndarray  # (W, F, K, D)
    by_parameter: np.ndarray  # (W, P, K, D)


class WindowPlayer:
    """Plays windows in worlds of one simulator."""

    def __init__(
        self,
        physics: Physics,
        prior_std: np.ndarray,
        fitted: np.ndarray,
        spans: Spans,
        lateness: Lateness | None = None,
    ):
        """`prior_std`: (2 nv,) of first guesses at states, 0 where they are exact; the other F are
        unknown. `fitted`: (P,) indices of the unknown parameters.

        With `lateness` a coordinate of each of its kinds follows the parameters.
        """
        self._physics, self.space, self._lateness = physics, physics.space, lateness
        self.fitted, self.unknown = fitted, np.flatnonzero(prior_std)
        self.prior_std = prior_std[self.unknown]  # (F,)
        self._delta = np.maximum(spans.state * self.prior_std, _SMALLEST_DELTA)
        self._span = spans.unit

    @property
    def num_worlds(self) -> int:
        """Played for the derivatives of one window."""
        return 1 + len(self.unknown) + 2 * len(self.fitted)

    def play(
        self, windows: Windows, states: np.ndarray, units: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Play from (G, W, nq + nv) initial states, with (G, N) unknowns shared by all windows.

        Returns (G, W, K, S) full states and (G, W, K, D) predictions.
        """
        groups, num_windows, size = states.shape
        num_late = len(self._lateness.kinds) if self._lateness else 0
        parameters, late = np.split(units, [units.shape[1] - num_late], 1)
        full_states, predicted = self._physics.play(
            states.reshape(-1, size),
            np.repeat(parameters, num_windows, 0),
            np.tile(windows.actions, (groups, 1, 1)),
            windows.left_behind(units).reshape(groups * num_windows, -1),
            1 if self._lateness is None else self._lateness.predictions_per_step,
        )
        full_states = full_states.reshape(groups, num_windows, *full_states.shape[1:])
        predicted = predicted.reshape(groups, num_windows, *predicted.shape[1:])
        if self._lateness is not None:
            predicted = self._lateness.seen(predicted, late[:, None])
        return full_states, predicted

    def differentiate(self, windows: Windows, point: LinearizationPoint) -> WindowSlopes:
        """Predictions at the point, and their derivatives, in the unknowns' units.

        Contacts make the motion rough: slopes across a small step are huge and random, and a fit
        that uses them stops where it began. So central differences span as much as windows disagree
        on the parameters, or more. Where a world diverges on one side, the other side alone counts.
        """
        num_states, num_fitted = len(self.unknown), len(self.fitted)
        tangents = np.zeros((1 + num_states + 2 * num_fitted, self.space.num_tangent))
        tangents[1 + np.arange(num_states), self.unknown] = self._delta
        spread = np.repeat(tangents[:, None], len(point.states), 1)
        states = self.space.move(point.states, spread)
        units = np.repeat(point.unit[None], len(tangents), 0)
        middle, away = point.unit[self.fitted], self._span * np.sqrt(point.variance)
        above, below = np.minimum(middle + away, 1), np.maximum(middle - away, 0)
        sides = 1 + num_states + np.arange(2 * num_fitted)
        units[sides, np.tile(self.fitted, 2)] = np.concatenate([above, below])
        _, predicted = self.play(windows, states, units)
        change = (predicted[1:] - predicted[0]).swapaxes(0, 1)
        # A world that diverges predicts what nothing is like: so large a change would make the
        # window seem to know exactly what was changed. So would one from a point that diverges.
        lost = (is_lost(predicted[1:]) | is_lost(predicted[0])).T
        change[lost] = 0.0
        by_state = change[:, :num_states] / self._delta[:, None, None]
        rise, fall = np.split(change[:, num_states:], 2, axis=1)
        no_rise, no_fall = np.split(lost[:, num_states:], 2, axis=1)
        span = ~no_rise * (above - middle) + ~no_fall * (middle - below)  # (W, P)
        span[span == 0] = np.inf
        by_parameter = (rise - fall) / span[..., None, None]
        return WindowSlopes(predicted[0], by_state, by_parameter)

    def linearize(
        self,
        windows: Windows,
        slopes: WindowSlopes,
        pull: np.ndarray,
        prior: np.ndarray,
        blur: float,
    ) -> tuple[NormalEquations, np.ndarray]:
        """Normal equations, and the windows' (W,) costs −log p(observed | states, parameters).

        `slopes`: predictions at the point, and derivatives there or near by. `pull`: (W, F)
        deviation of the states from their first guesses, divided by `prior`, (F,), the standard
        deviation of these guesses. With residuals r, weights w and noise σ of the evidence,
        J = ∂r/∂(states), K = ∂r/∂(unit, common), W = diag(w), S = diag(prior):

            H = Jᵀ W J + S⁻²     C = Jᵀ W K     B = Kᵀ W K
            g = Jᵀ W r + S⁻¹ pull               b = Kᵀ W r

        and `eliminate` leaves the P parameters and Q common errors.
        """
        predicted, by_state, by_parameter = slopes
        by_common = directions(windows.evidence)[None, :, None]  # (1, Q, 1, D)
        shape = len(predicted), by_common.shape[1], *predicted.shape[1:]
        by_shared = np.concatenate([by_parameter, np.broadcast_to(by_common, shape)], 1)
        residual, weight = windows.evidence.linearize(predicted, blur)
        scale, num = blur * windows.evidence.scale, len(residual)
        r, w = residual.reshape(num, -1), weight.reshape(num, -1)  # (W, M = K · D)
        num_residuals = r.shape[1]
        jacobian = (by_state / scale).reshape(*by_state.shape[:2], num_residuals)  # (W, F, M)
        sensitivity = (by_shared / scale).reshape(
            *by_shared.shape[:2], num_residuals
        )  # (W, P + Q, M)
        hessian = np.einsum("wsm,wm,wtm->wst", jacobian, w, jacobian, optimize=True)
        hessian += np.diag(prior**-2)
        cross = np.einsum("wsm,wm,wpm->wsp", jacobian, w, sensitivity, optimize=True)
        direct = np.einsum("wpm,wm,wqm->wpq", sensitivity, w, sensitivity, optimize=True)
        gradient = np.einsum("wsm,wm,wm->ws", jacobian, w, r) + pull / prior
        direct_gradient = np.einsum("wpm,wm,wm->wp", sensitivity, w, r)
        # Undamped: a window with damped, fixed states would seem to know the parameters well.
        equations = eliminate(
            hessian, cross, gradient, direct, direct_gradient, ridged=ridged(hessian)
        )
        return equations, -windows.evidence.log_likelihood(predicted, blur)


def ridged(hessian: np.ndarray) -> np.ndarray:
    """(W, S, S) that can be inverted, though sharp sensors and a weak prior differ by much."""
    return hessian + _RIDGE * diagonal(hessian)


def diagonal(matrices: np.ndarray) -> np.ndarray:
    """(W, S, S) with all off-diagonal entries zero."""
    return np.einsum("wss->ws", matrices)[:, None] * np.eye(matrices.shape[1])
