"""Multiple shooting: the physics is replayed in short windows and fitted to what was observed.

In each window the initial state is unknown as well (Bock and Plitt 1984), so that no error grows
for long and no contact is followed for long. Gauss-Newton finds parameters and initial states
together; finite differences are free, since all perturbed worlds run at once. Where short windows
do not tell enough, the horizon is extended as long as the motion is explained as well: a slow
swing shows its period late.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from simtune.fit.combine import FIRST_VARIANCE, combine, robust_weights
from simtune.fit.linearization import LinearizationPoint, Slopes, WindowPlayer, diagonal
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.windows import Windows, cut

_PRIOR = 3.0  # a first guess at a state counts as this much less sure than it measured itself
# And in a stage that is not blurred by so much less again: it comes from worlds with other
# parameters, so that it would draw the parameters to where they began, and say that it is sure.
_LAST_PRIOR = 10.0
_STATES_ONLY = 3.0  # with more blur than this, parameters wait for the states
_LARGEST_STEP = 0.12  # of the whole range (unit coordinates)
_LARGEST_STATE_STEP = 4.0  # prior standard deviations
_FIRST_DAMPING, _DAMPING = 1e-2, (1e-6, 1e4)
_FULL_STEPS = 3  # iterations of a stage; later ones take half of each step in the parameters
_EXTENDED_BLUR = 3.0
_DERIVED_EVERY = 3  # iterations (the chord method): derivatives cost most, and change slowly,
_WITH_LAGS = 2  # ... unless what is left behind before a window changes, too
_TRIED = 2  # worlds, with which it is seen whether a step is one for the better
_LAG_DELTA = 0.01  # in unit coordinates
_ENOUGH = 0.01  # standard deviation of a parameter, in unit coordinates
_AS_WELL = 1.0  # by so much −log likelihood may rise: distances half as large again, or so


class Stage(NamedTuple):
    window: int  # steps
    iterations: int
    blur: float = 1.0  # a factor on the noise


@dataclass(frozen=True, kw_only=True)
class ShootingConfig:
    # Short and blurred first, which brings the states near from far away.
    stages: tuple[Stage, ...] = (Stage(4, 6, 6.0), Stage(8, 3, 2.0), Stage(12, 6))
    longer: tuple[int, ...] = (24, 48, 96)  # windows, where those do not tell enough
    longer_iterations: int = 5  # blurred, and as many that are not
    num_windows: int = 90  # at most; spread evenly. Of longer ones fewer: as many steps in all

    def steps_per_window(self, num_derived: int) -> int:
        """Steps that a fit plays of each of these windows, where it derives by so many worlds."""
        return sum(s.window * _worlds(s.iterations, num_derived) for s in self.stages)

    def steps_of_longer(self, num_derived: int) -> int:
        """The same of the first longer windows, which are always tried; others are rare."""
        each = _worlds(self.longer_iterations, num_derived)
        return 2 * self.stages[-1].window * each * bool(self.longer)


def _worlds(iterations: int, num_derived: int) -> int:
    """That play each window in so many iterations."""
    return num_derived * -(-iterations // _DERIVED_EVERY) + _TRIED * iterations


@dataclass(frozen=True)
class ShootingFit:
    """What a fit found, in unit coordinates of the fitted parameters."""

    unit: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    full_states: np.ndarray  # (W, K, S) of the windows' steps, as simulated
    episode: np.ndarray  # (W,)
    step: np.ndarray  # (W,) at which each window begins
    misfit: np.ndarray  # (W,) mean of −log likelihood of an observation
    distances: tuple[float, ...]  # each sensor's typical distance from what it is sure of


class Shooting:
    """Fits parameters `fitted` (indices) of worlds to what was observed."""

    def __init__(
        self, physics: Physics, prior_std: np.ndarray, fitted: np.ndarray, config: ShootingConfig
    ):
        """`prior_std`: (2 nv,) usual errors of first guesses at states."""
        self._physics, self._space, self.config = physics, physics.space, config
        self._prior_std, self.fitted = prior_std * _PRIOR, np.asarray(fitted)
        self._player = WindowPlayer(physics, self._prior_std, self.fitted)
        self._lags = [i for i in self.fitted if physics.parameters.parameters[i].is_lag]

    def fit(self, observed: Observed, states: np.ndarray, parameters: np.ndarray) -> ShootingFit:
        """From a first guess at the (E, T + 1, nq + nv) states and at the (N,) parameters."""
        unit = self._physics.parameters.to_unit(parameters)
        replay = partial(self._physics.replay_actuators, observed.actions, states)
        return self._fit(self._cut(observed, states, unit), unit, self.config.stages, replay)

    def extend_horizon(
        self, observed: Observed, states: np.ndarray, parameters: np.ndarray, fit: ShootingFit
    ) -> ShootingFit:
        """`fit`, or one with the longest windows that are nearly as well explained.

        The others, (N,) parameters, and states outside of the fit's windows, are as for `fit`.
        """
        config, unit = self.config, self._physics.parameters.to_unit(parameters)
        best = found = fit
        limit = np.median(best.misfit) + _AS_WELL
        for window in config.longer:
            # The first of them always: it takes little, and what short ones claim may be too much.
            is_known = np.diag(best.covariance).max(initial=0) < _ENOUGH**2
            is_known &= window > config.longer[0]
            if is_known or window > observed.actions.shape[1]:
                break
            unit[self.fitted] = found.unit
            improved = self._improved(states, found)
            longer = self._cut(observed, improved, unit, window)
            replay = partial(self._physics.replay_actuators, observed.actions, improved)
            # Blurred at first: what ends far away after such a time is no outlier yet.
            count = config.longer_iterations
            stages = (Stage(window, count, _EXTENDED_BLUR), Stage(window, count))
            found = self._fit(longer, unit, stages, replay)
            if np.median(found.misfit) > limit:
                break
            best = found
        return best

    def fisher_covariance(
        self, observed: Observed, states: np.ndarray, parameters: np.ndarray
    ) -> np.ndarray:
        """(P, P) covariance, in unit coordinates, that a fit to such data would have at best.

        By Fisher information where the (N,) parameters and the states, as in `fit`, are the true
        ones. The windows' initial states count as unknown, and FIRST_VARIANCE lies between windows.
        """
        unit = self._physics.parameters.to_unit(parameters)
        windows = self._cut(observed, states, unit)
        point = LinearizationPoint(
            windows.states, unit, np.zeros(len(windows.states)), FIRST_VARIANCE
        )
        pull = np.zeros((len(windows.states), len(self._prior_std)))
        slopes = self._player.differentiate(windows, point)
        prior = self._prior_std
        information = self._player.linearize(windows, slopes, pull, prior, 1.0)[0].information
        eye = np.eye(len(self.fitted))
        # As `combine` weighs windows: none tells more than the variance between them allows.
        shrunk = information @ np.linalg.inv(eye + FIRST_VARIANCE * information)
        return np.linalg.inv(shrunk.sum(0) + 1e-6 * eye)

    def _fit(
        self,
        whole: Windows,
        unit: np.ndarray,
        stages: tuple[Stage, ...],
        replay: Callable[[np.ndarray], np.ndarray],
    ) -> ShootingFit:
        """From (N,) parameters in unit coordinates, for which `replay` is `replay_actuators`."""
        windows, num = whole, len(whole.states)
        damping = np.full(num, _FIRST_DAMPING)
        point = LinearizationPoint(whole.states.copy(), unit, damping, FIRST_VARIANCE)
        covariance = np.zeros((len(self.fitted),) * 2)
        for stage in stages:
            windows = whole.first(stage.window)
            point = replace(point, damping=damping, step_scale=1.0)
            slopes, derived_every = None, _WITH_LAGS if self._lags else _DERIVED_EVERY
            for iteration in range(stage.iterations):
                share = 1.0 if iteration < _FULL_STEPS else 0.5
                share = 0.0 if stage.blur > _STATES_ONLY else share
                if slopes is None or iteration % derived_every == 0:
                    windows = self._with_lags(windows, point.unit, replay)
                    slopes = self._player.differentiate(windows, point)
                point, covariance, predicted = self._step(windows, point, slopes, share, stage.blur)
                slopes = slopes._replace(predicted=predicted)
        full_states, predicted = self._player.play(windows, point.states[None], point.unit[None])
        evidence, num_frames = windows.evidence, predicted.shape[2]
        return ShootingFit(
            point.unit[self.fitted],
            covariance,
            full_states[0],
            windows.episode,
            windows.step,
            -evidence.log_likelihood(predicted[0]) / (num_frames * evidence.num_observations),
            evidence.distances(predicted[0]),
        )

    def _with_lags(
        self, windows: Windows, unit: np.ndarray, replay: Callable[[np.ndarray], np.ndarray]
    ) -> Windows:
        """How far filters had followed when a window began depends on the lag that is fitted."""
        if not self._lags:
            return windows
        begun = replay(unit)[windows.episode, windows.step]
        by_lag = {}
        for lag in self._lags:
            step = np.zeros_like(unit)
            step[lag] = -_LAG_DELTA if unit[lag] > 0.5 else _LAG_DELTA
            changed = replay(unit + step)[windows.episode, windows.step]
            by_lag[lag] = unit[lag], (changed - begun) / step[lag]
        return replace(windows, actuator_states=begun, by_lag=by_lag)

    def _step(
        self,
        windows: Windows,
        point: LinearizationPoint,
        slopes: Slopes,
        share: float,
        blur: float,
    ) -> tuple[LinearizationPoint, np.ndarray, np.ndarray]:
        """One step of Gauss-Newton; the point after it, and the parameters' (P, P) covariance.

        Also the (W, K, D) predictions at the point after it.

        Over the W windows' initial states x_w and the parameters θ that all share, it minimises

            Σ_w −log p(observed_w | x_w, θ) + ½ ‖S⁻¹ (x_w ⊖ x̄_w)‖²

        with x̄_w the first guess and S = diag(prior). Near the point (`linearize`) that is

            [H_w   C_w] [δx_w]     [g_w]
            [C_wᵀ  B_w] [δθ  ] = − [b_w]

        The states go first, by the Schur complement: each window then says what it knows of θ
        alone, I_w = B_w − C_wᵀ H_w⁻¹ C_w, and `combine` takes its step δθ from all of them. Then
        δx_w = −(H_w + λ_w diag H_w)⁻¹ (g_w + C_w δθ), with Levenberg-Marquardt damping λ_w.
        A window whose cost rises keeps its states; if the weighted sum of all rises, nothing
        moves, and the next step in θ is a quarter as long.
        """
        prior = self._prior_std * (_LAST_PRIOR if blur <= 1 else 1.0)
        pull = self._pull(point.states, windows, prior)  # (W, 2 nv)
        equations, cost = self._player.linearize(windows, slopes, pull, prior, blur)
        trust = robust_weights(cost)  # (W,)
        combined = combine(
            equations.information,
            equations.parameter_gradient,
            point.variance,
            trust / (1 + point.damping),
        )
        step = combined.step(point.unit[self.fitted], _LARGEST_STEP)  # (P,)
        unit = point.unit.copy()
        unit[self.fitted] = np.clip(unit[self.fitted] + share * point.step_scale * step, 0, 1)
        moved = self._move_states(point, equations, unit[self.fitted] - point.unit[self.fitted])
        # Costs (2, W) with the parameters moved: with the states moved, too, and without
        _, predicted = self._player.play(
            windows, np.stack([moved, point.states]), np.stack([unit, unit])
        )
        pulls = np.stack([self._pull(moved, windows, prior), pull])
        costs = -windows.evidence.log_likelihood(predicted, blur)
        costs += 0.5 * np.square(pulls).sum(-1)
        before = cost + 0.5 * np.square(pull).sum(-1)
        if trust @ costs.min(0) > trust @ before:  # too far for a straight line
            shorter = replace(point, step_scale=point.step_scale / 4)
            return shorter, combined.covariance, slopes.predicted
        better = costs[0] < costs[1]
        states = np.where(better[:, None], moved, point.states)
        damping = np.where(better, point.damping / 4, point.damping * 8).clip(*_DAMPING)
        step_scale = min(1.0, 2 * point.step_scale)
        after = LinearizationPoint(states, unit, damping, combined.variance, step_scale)
        its = np.where(better[:, None, None], predicted[0], predicted[1])
        return after, combined.covariance, its

    def _move_states(self, point: LinearizationPoint, equations, change: np.ndarray) -> np.ndarray:
        """(W, nq + nv) states after the best step when the parameters change by (P,)."""
        hessian = equations.hessian
        damped = hessian + point.damping[:, None, None] * diagonal(hessian)
        gradient = equations.gradient + equations.cross @ change
        tangent = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        limit = _LARGEST_STATE_STEP * self._prior_std
        return self._space.move(point.states, np.clip(tangent, -limit, limit))

    def _pull(self, states: np.ndarray, windows: Windows, prior: np.ndarray) -> np.ndarray:
        """(W, 2 nv) S⁻¹ (x ⊖ x̄), with S = diag(prior)."""
        return self._space.difference(states, windows.states) / prior

    def _cut(
        self, observed: Observed, states: np.ndarray, unit: np.ndarray, steps: int | None = None
    ) -> Windows:
        """By default as long as the last stage's; whatever the length, as many steps in all."""
        usual = self.config.stages[-1].window
        steps = steps or usual
        actuator_states = self._physics.replay_actuators(observed.actions, states, unit)
        at_most = self.config.num_windows * usual
        return cut(observed, states, actuator_states, steps, max(1, at_most // steps))

    def _improved(self, states: np.ndarray, fit: ShootingFit) -> np.ndarray:
        """(E, T + 1, nq + nv) states, those of a fit's windows as it has them."""
        states = states.copy()
        steps = fit.step[:, None] + np.arange(fit.full_states.shape[1])
        states[fit.episode[:, None], steps] = self._physics.states(fit.full_states)
        return states
