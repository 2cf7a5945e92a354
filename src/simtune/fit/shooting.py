"""Multiple shooting: the physics is replayed in short windows and fitted to what the detector saw.

In each window the initial state is unknown as well, so that no error grows for long and no
contact is followed for long. Gauss-Newton finds parameters and initial states together; finite
differences are free, since all perturbed worlds run at once. Where short windows do not tell
enough, they grow for as long as they are explained as well: a slow swing shows its period late.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.fit.combine import FIRST_VARIANCE, combine, robust_weights
from simtune.fit.linearization import (
    LinearizationPoint,
    WindowPlayer,
    diagonal,
    eliminate,
    residuals,
)
from simtune.fit.physics import Physics
from simtune.fit.tracks import Tracks
from simtune.fit.windows import Windows, cut

_PRIOR = 3.0  # a first guess at a state counts as this much less sure than it measured itself
_STATES_ONLY = 3.0  # with more blur than this, parameters wait for the states
_LARGEST_STEP = 0.12  # of the whole range (unit coordinates)
_GROWN_BLUR = 3.0
_ENOUGH = 0.01  # standard deviation of a parameter, in unit coordinates
_AS_WELL = 1.0  # by so much −log likelihood may rise: distances half as large again, or so


class Stage(NamedTuple):
    window: int  # steps
    iterations: int
    blur: float = 1.0  # a factor on the detector's noise


@dataclass(frozen=True, kw_only=True)
class ShootingConfig:
    # Short and blurred first, which brings the states near from far away.
    stages: tuple[Stage, ...] = (Stage(4, 6, 6.0), Stage(8, 3, 2.0), Stage(12, 6))
    longer: tuple[int, ...] = (24, 48, 96)  # windows, where those do not tell enough
    longer_iterations: int = 10  # blurred, and as many that are not
    num_windows: int = 90  # at most; spread evenly. Of longer ones fewer: as many steps in all

    @property
    def steps_per_window(self) -> int:
        """How many steps a fit plays of each of these windows; what grows is rare."""
        return sum(stage.window * stage.iterations for stage in self.stages)


@dataclass(frozen=True)
class ShootingFit:
    """What a fit found, in unit coordinates of the fitted parameters."""

    unit: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    rows: np.ndarray  # (W, K, S) states of the windows' steps, as simulated
    episode: np.ndarray  # (W,)
    step: np.ndarray  # (W,) at which each window begins
    misfit: np.ndarray  # (W,) mean of −log likelihood of an observation
    residual_px: float  # median distance of what the detector is sure of


class Shooting:
    """Fits parameters `fitted` (indices) of worlds to tracks."""

    def __init__(
        self,
        physics: Physics,
        noise_px: np.ndarray,
        spread: np.ndarray,
        fitted: np.ndarray,
        config: ShootingConfig,
    ):
        """`noise_px`: (L,) where the detector is sure; `spread`: (2 nv,) usual errors of first guesses."""
        self._physics, self._space, self.config = physics, physics.space, config
        self._noise_px = self._noise = np.asarray(noise_px)  # of the detector, and as it is blurred
        self._spread, self.fitted = spread * _PRIOR, np.asarray(fitted)
        self._player = WindowPlayer(physics, self._spread, self.fitted)

    def fit(self, tracks: Tracks, states: np.ndarray, parameters: np.ndarray) -> ShootingFit:
        """From a first guess at the (E, T + 1, nq + nv) states and at the (N,) parameters."""
        unit = self._physics.parameters.to_unit(parameters)
        return self._fit(self._cut(tracks, states, unit), unit, self.config.stages)

    def grow(
        self, tracks: Tracks, states: np.ndarray, parameters: np.ndarray, fit: ShootingFit
    ) -> ShootingFit:
        """`fit`, or one with the longest windows that are nearly as well explained.

        The others, (N,) parameters, and states outside of the fit's windows, are as for `fit`.
        """
        config, unit = self.config, self._physics.parameters.to_unit(parameters)
        best = found = fit
        limit = np.median(best.misfit) + _AS_WELL
        for window in config.longer:
            told = np.diag(best.covariance).max(initial=0) < _ENOUGH**2
            if told or window > tracks.actions.shape[1]:
                break
            unit[self.fitted] = found.unit
            longer = self._cut(tracks, self._improved(states, found), unit, window)
            # Blurred at first: what ends far away after so long is no outlier yet.
            count = config.longer_iterations
            found = self._fit(
                longer, unit, (Stage(window, count, _GROWN_BLUR), Stage(window, count))
            )
            if np.median(found.misfit) < limit:
                best = found
        return best

    def _fit(self, whole: Windows, unit: np.ndarray, stages: tuple[Stage, ...]) -> ShootingFit:
        """From (N,) parameters in unit coordinates."""
        windows = whole
        guess = LinearizationPoint(
            windows.states.copy(), unit, np.full(len(windows.states), 1e-2), FIRST_VARIANCE
        )
        covariance = np.zeros((len(self.fitted),) * 2)
        for stage in stages:
            windows = whole.first(stage.window)
            self._noise = stage.blur * self._noise_px
            guess = replace(guess, damping=np.full(len(guess.damping), 1e-2), step_scale=1.0)
            for iteration in range(stage.iterations):
                step_size = 0.0 if stage.blur > _STATES_ONLY else 1.0 if iteration < 3 else 0.5
                guess, covariance = self._step(windows, guess, step_size)
        rows, seen = self._player.play(windows, guess.states[None], guess.unit[None])
        residual = residuals(windows, seen, self._noise)
        nearest = windows.nearest(residual[0])  # (W, K, L, 2)
        distance = np.linalg.norm(nearest, axis=-1) * self._noise
        sure = windows.probability.sum(2) > 0.9
        return ShootingFit(
            guess.unit[self.fitted],
            covariance,
            rows[0],
            windows.episode,
            windows.step,
            windows.cost(residual)[0] / distance[0].size,
            float(np.median(distance[sure])) if sure.any() else float("nan"),
        )

    def told(self, tracks: Tracks, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(P, P) covariance, in unit coordinates, that a fit to such tracks would have at best.

        By Fisher information where the (N,) parameters and the states, as in `fit`, are the true
        ones. The windows' initial states count as unknown, and FIRST_VARIANCE lies between windows.
        """
        unit = self._physics.parameters.to_unit(parameters)
        windows = self._cut(tracks, states, unit)
        guess = LinearizationPoint(
            windows.states, unit, np.zeros(len(windows.states)), FIRST_VARIANCE
        )
        residual, by_state, by_parameter = self._player.linearise(windows, guess, self._noise)
        weight = windows.weight(residual)
        information = eliminate(by_state, by_parameter, weight, self._spread)[-1]
        eye = np.eye(len(self.fitted))
        # As `combine` weighs windows: none tells more than the variance between them allows.
        shrunk = information @ np.linalg.inv(eye + FIRST_VARIANCE * information)
        return np.linalg.inv(shrunk.sum(0) + 1e-6 * eye)

    def _step(self, windows: Windows, guess: LinearizationPoint, step_size: float):
        """One step of Gauss-Newton; the guess after it, and the parameters' covariance."""
        residual, by_state, by_parameter = self._player.linearise(windows, guess, self._noise)
        weight = windows.weight(residual)  # (W, M)
        flat = windows.nearest(residual).reshape(len(weight), -1)
        hessian, cross, to_parameters, information = eliminate(
            by_state, by_parameter, weight, self._spread
        )
        pull = self._space.difference(guess.states, windows.states) / self._spread
        slope = np.einsum("wsm,wm,wm->ws", by_state, weight, flat) + pull / self._spread
        of_parameters = np.einsum("wpm,wm,wm->wp", by_parameter, weight, flat)
        of_parameters -= np.einsum("wsp,ws->wp", to_parameters, slope)
        cost = windows.cost(residual[None])[0]
        trust, anchored = robust_weights(cost), 0.5 * np.square(pull).sum(-1)
        told = combine(information, of_parameters, guess.variance, trust / (1 + guess.damping))
        change = told.step(guess.unit[self.fitted], _LARGEST_STEP)
        unit = guess.unit.copy()
        unit[self.fitted] = np.clip(unit[self.fitted] + step_size * guess.step_scale * change, 0, 1)
        change = unit[self.fitted] - guess.unit[self.fitted]
        damped = hessian + guess.damping[:, None, None] * diagonal(hessian)
        tangent = -np.linalg.solve(damped, (slope + cross @ change)[..., None])[..., 0]
        tangent = np.clip(tangent, -4 * self._spread, 4 * self._spread)
        moved = self._space.move(guess.states, tangent)
        _, seen = self._player.play(
            windows, np.stack([moved, guess.states]), np.stack([unit, unit])
        )
        pulled = self._space.difference(moved, windows.states) / self._spread
        costs = windows.cost(residuals(windows, seen, self._noise))
        costs += np.stack([0.5 * np.square(pulled).sum(-1), anchored])
        if trust @ costs.min(0) > trust @ (cost + anchored):  # too far for a straight line
            return replace(guess, step_scale=guess.step_scale / 4), told.covariance
        better = costs[0] < costs[1]
        states = np.where(better[:, None], moved, guess.states)
        damping = np.where(better, guess.damping / 4, guess.damping * 8).clip(1e-6, 1e4)
        step_scale = min(1.0, 2 * guess.step_scale)
        return LinearizationPoint(states, unit, damping, told.variance, step_scale), told.covariance

    def _cut(
        self, tracks: Tracks, states: np.ndarray, unit: np.ndarray, steps: int | None = None
    ) -> Windows:
        """By default as long as the last stage's; however long, of as many steps in all."""
        usual = self.config.stages[-1].window
        steps = steps or usual
        actuator_state = self._physics.after(tracks.actions, states, unit)
        at_most = self.config.num_windows * usual
        return cut(tracks, states, actuator_state, steps, max(1, at_most // steps))

    def _improved(self, states: np.ndarray, fit: ShootingFit) -> np.ndarray:
        """(E, T + 1, nq + nv) states, those of a fit's windows as it has them."""
        states = states.copy()
        steps = fit.step[:, None] + np.arange(fit.rows.shape[1])
        states[fit.episode[:, None], steps] = self._physics.states(fit.rows)
        return states
