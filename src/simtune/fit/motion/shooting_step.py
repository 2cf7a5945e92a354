"""One Gauss-Newton step of multiple shooting: parameters and windows' states together."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.fit.combine import COMMON_STD, combine, robust_weights
from simtune.fit.elimination import NormalEquations
from simtune.fit.motion.common_errors import directions
from simtune.fit.motion.linearization import (
    LinearizationPoint,
    WindowPlayer,
    WindowSlopes,
    diagonal,
    ridged,
)
from simtune.fit.motion.shooting_config import Stage
from simtune.fit.motion.windows import Windows

_LARGEST_STEP = 0.12  # in unit coordinates
_LARGEST_STATE_STEP = 4.0  # in prior standard deviations
_DAMPING = (1e-6, 1e4)
_WINDOWS_QUANTILE = 0.9  # of them, only those with contacts determine a height


class Stepped(NamedTuple):
    """Result of a step."""

    point: LinearizationPoint
    covariance: np.ndarray  # (P, P) of the parameters, and of latenesses if they are fitted
    predicted: np.ndarray  # (W, K, D) at the point
    hessian: np.ndarray  # (W, F, F) of the windows' initial states


class _Proposal(NamedTuple):
    """Where a step leads, before it is known whether costs fall."""

    unit: np.ndarray  # (N,) parameters; (N + G,) with latenesses
    common: np.ndarray  # (Q,) common errors
    states: np.ndarray  # (2, W, nq + nv) of the windows: moved, and as they were


class ShootingStep:
    """Steps in what a player's windows share, and in their initial states."""

    def __init__(self, player: WindowPlayer):
        self._player, self._space = player, player.space
        self._fitted, self._prior_std = player.fitted, player.prior_std

    def information(self, windows: Windows, point: LinearizationPoint) -> np.ndarray:
        """(W, P, P) information of each window on the parameters, its initial state unknown.

        It takes errors as independent.
        """
        pull = np.zeros((len(windows.states), len(self._prior_std)))
        slopes = self._player.differentiate(windows, point)
        equations, _ = self._player.linearize(windows, slopes, pull, self._prior_std, 1.0)
        num = len(self._fitted)
        return equations.information[:, :num, :num]

    def take(
        self,
        windows: Windows,
        point: LinearizationPoint,
        slopes: WindowSlopes,
        share: float,
        stage: Stage,
    ) -> Stepped:
        """One step from `point`; parameters move by a `share` of it.

        Over the W windows' initial states x_w and the shared unknowns θ, it minimises

            Σ_w −log p(observed_w | x_w, θ) + ½ ‖S⁻¹ (x_w ⊖ x̄_w)‖²

        with x̄_w the first guess and S = diag(prior), for what is unknown of the states. θ has the
        parameters, and the common errors, which have a prior of their own. Linearised at the point
        (`linearize`) that is

            [H_w   C_w] [δx_w]     [g_w]
            [C_wᵀ  B_w] [δθ  ] = − [b_w]

        The states are eliminated by the Schur complement: each window's information on θ alone is
        I_w = B_w − C_wᵀ H_w⁻¹ C_w, and `combine` computes the step δθ from all of them. Then
        δx_w = −(H_w + λ_w diag H_w)⁻¹ (g_w + C_w δθ), with Levenberg-Marquardt damping λ_w.
        A window whose cost rises keeps its states; if the weighted sum of all rises, nothing moves,
        and the next step in θ is a quarter as long.
        """
        prior, blur = self._prior_std * stage.prior_factor, stage.blur
        pull = self._pull(point.states, windows, prior)  # (W, F)
        common = point.common
        errors = common @ directions(windows.evidence)
        seen = slopes._replace(predicted=slopes.predicted + errors)
        equations, cost = self._player.linearize(windows, seen, pull, prior, blur)
        trust = robust_weights(cost)  # (W,)
        combined = combine(
            equations.information,
            equations.shared_gradient,
            point.variance,
            trust / (1 + point.damping),
            common,
        )
        whole = combined.step(point.unit[self._fitted], _LARGEST_STEP)  # (P + Q,)
        proposal = self._propose(point, equations, share * point.step_scale * whole, common)
        costs, predicted = self._costs(windows, proposal, prior, blur)
        before, found = cost + 0.5 * np.square(pull).sum(-1), proposal.common
        rise = 0.5 * (found @ found - common @ common) / COMMON_STD**2
        if trust @ costs.min(0) + rise > trust @ before:  # beyond the linear range
            shorter = replace(point, step_scale=point.step_scale / 4)
            return Stepped(shorter, combined.covariance, slopes.predicted, equations.hessian)
        is_better = costs[0] < costs[1]
        after = _accepted(point, proposal, is_better, combined.variance)
        reached = np.where(is_better[:, None, None], *predicted)
        return Stepped(after, combined.covariance, reached, equations.hessian)

    def _propose(
        self,
        point: LinearizationPoint,
        equations: NormalEquations,
        step: np.ndarray,
        common: np.ndarray,
    ) -> _Proposal:
        """The result of a (P + Q,) step of the shared unknowns, from `point` and `common`, (Q,).

        Parameters stay within their bounds; states follow the step that is left.
        """
        unit, num = point.unit.copy(), len(self._fitted)
        unit[self._fitted] = np.clip(unit[self._fitted] + step[:num], 0, 1)
        change = np.concatenate([unit[self._fitted] - point.unit[self._fitted], step[num:]])
        states = np.stack([self._move_states(point, equations, change), point.states])
        return _Proposal(unit, common + step[num:], states)

    def _costs(
        self, windows: Windows, proposal: _Proposal, prior: np.ndarray, blur: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(2, W) costs from either of the proposed states, and (2, W, K, D) predictions.

        Predictions are without the common errors.
        """
        states, unit = proposal.states, proposal.unit
        _, predicted = self._player.play(windows, states, np.stack([unit, unit]))
        pulls = np.stack([self._pull(either, windows, prior) for either in states])
        common = proposal.common @ directions(windows.evidence)
        costs = -windows.evidence.log_likelihood(predicted + common, blur)
        return costs + 0.5 * np.square(pulls).sum(-1), predicted

    def _move_states(
        self, point: LinearizationPoint, equations: NormalEquations, change: np.ndarray
    ) -> np.ndarray:
        """(W, nq + nv) states after the best step, given the change (P + Q,) of shared unknowns."""
        hessian = equations.hessian
        damped = hessian + point.damping[:, None, None] * diagonal(hessian)
        gradient = equations.gradient + equations.cross @ change
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        limit = _LARGEST_STATE_STEP * self._prior_std
        tangent = np.zeros((len(step), self._space.num_tangent))
        tangent[:, self._player.unknown] = np.clip(step, -limit, limit)
        return self._space.move(point.states, tangent)

    def state_std(self, hessian: np.ndarray) -> np.ndarray:
        """(2 nv,) by H⁻¹ of nearly all windows, given the parameters; 0 where states are exact."""
        std = np.zeros(self._space.num_tangent)
        variance = np.linalg.inv(ridged(hessian)).diagonal(axis1=1, axis2=2)  # (W, F)
        of_most = np.quantile(variance.clip(0), _WINDOWS_QUANTILE, 0) if len(variance) else np.inf
        std[self._player.unknown] = np.sqrt(of_most)
        return std

    def _pull(self, states: np.ndarray, windows: Windows, prior: np.ndarray) -> np.ndarray:
        """(W, F) S⁻¹ (x ⊖ x̄), with S = diag(prior)."""
        return self._space.difference(states, windows.states)[:, self._player.unknown] / prior


def _accepted(
    point: LinearizationPoint, proposal: _Proposal, is_better: np.ndarray, variance: float
) -> LinearizationPoint:
    """The proposal; windows keep their states where these are not better, (W,) bool.

    `variance`: between windows. Steps grow back to full ones.
    """
    return LinearizationPoint(
        states=np.where(is_better[:, None], *proposal.states),
        unit=proposal.unit,
        damping=np.where(is_better, point.damping / 4, point.damping * 8).clip(*_DAMPING),
        variance=variance,
        step_scale=min(1.0, 2 * point.step_scale),
        common=proposal.common,
    )
