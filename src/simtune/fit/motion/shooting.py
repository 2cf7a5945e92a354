"""Multiple shooting: fits short windows of the physics to observations.

Each window's initial state is unknown as well (Bock and Plitt 1984), so that errors do not grow and
contacts are not followed for long. Gauss-Newton finds parameters and initial states together;
finite differences are cheap, since all perturbed worlds run in one batch. If short windows do not
tell enough, they are extended for as long as they still explain the motion: a slow swing shows its
period late.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from simtune.budget import NO_LIMIT, Budget, timed
from simtune.fit.combine import FIRST_VARIANCE
from simtune.fit.lateness import Lateness, late_unit, steps_late_and_std
from simtune.fit.motion.actuator_replay import ActuatorReplay
from simtune.fit.motion.common_errors import Beside, beside, directions
from simtune.fit.motion.linearization import LinearizationPoint, WindowPlayer
from simtune.fit.motion.shooting_config import DERIVED_EVERY, ShootingConfig, Stage
from simtune.fit.motion.shooting_step import ShootingStep, Stepped
from simtune.fit.motion.windows import Windows, cut, even_length, not_longer
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics

_PRIOR_STD_FACTOR = 3.0  # on first guesses: the estimator overstates its accuracy
_FIRST_DAMPING = 1e-2
# Iterations: the actuator state at a window's start also depends on the lag
_DERIVED_EVERY_WITH_LAGS = 2
_FULL_STEPS = 3  # iterations of a stage; later ones take half of each parameter step
_EXTENDED_BLUR = 3.0
_WELL_KNOWN_STD = 0.01  # of a parameter, in unit coordinates
_MOST_WORLDS_AT_ONCE = 512  # in which derivatives are asked: a cloth's window has hundreds
_ASKING = "asking how well the best fit could tell: {} of {} short windows"
_MAX_MISFIT_RISE = 1.0  # of −log likelihood: distances about half as large again


@dataclass(frozen=True)
class ShootingFit:
    """Result of a fit, in unit coordinates of the fitted parameters."""

    unit: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    full_states: np.ndarray  # (W, K, S) of the windows' steps, as simulated
    episode: np.ndarray  # (W,)
    step: np.ndarray  # (W,) first step of each window
    misfit: np.ndarray  # (W,) mean −log likelihood per observation
    distances: tuple[float, ...]  # each sensor's typical distance, where it is certain
    # (2 nv,) std of the windows' initial states, in nine of ten at most, given the parameters
    state_std: np.ndarray
    # {"pictures": (lateness in steps, standard deviation)}, also of readings; empty: not fitted
    late: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    beside: tuple[Beside, ...] = ()  # of each camera


class Shooting:
    """Fits the parameters `fitted` (indices) to observations."""

    def __init__(
        self,
        physics: Physics,
        prior_std: np.ndarray,
        fitted: np.ndarray,
        config: ShootingConfig,
        lateness: Lateness | None = None,
    ):
        """`prior_std`: (2 nv,) usual errors of first guesses at states; 0: these are exact.

        `lateness`: of what is late by an unknown time, which is fitted as well.
        """
        self._physics, self.config, self.fitted = physics, config, np.asarray(fitted)
        self._late = lateness.kinds if lateness else ()
        self._on_time = np.full(len(self._late), late_unit(0.0))
        last = len(physics.parameters) + np.arange(len(self._on_time))
        unknown = np.concatenate([self.fitted, last]).astype(int)
        self._player = WindowPlayer(
            physics, prior_std * _PRIOR_STD_FACTOR, unknown, config.spans, lateness
        )
        self._step = ShootingStep(self._player)
        self._lags = [i for i in self.fitted if physics.parameters.parameters[i].is_lag]

    def fit(self, observed: Observed, states: np.ndarray, parameters: np.ndarray) -> ShootingFit:
        """From first guesses at the (E, T + 1, nq + nv) states and the (N,) parameters."""
        unit = self._begin(parameters)
        replay = self._replay(observed, states)
        windows = self._cut(observed, states, replay(unit))
        return self._result(*self._descend(windows, unit, self.config.stages, replay))

    def extend_horizon(
        self,
        observed: Observed,
        states: np.ndarray,
        parameters: np.ndarray,
        fit: ShootingFit,
        budget: Budget = NO_LIMIT,
    ) -> ShootingFit:
        """The fit with the longest windows that are nearly as well explained; maybe `fit` itself.

        Parameters that are not fitted, and states outside of the fit's windows, are as for `fit`.
        Only the first longer windows are tried if others would not end within the `budget`.
        """
        took_s, num_steps, longer = 0.0, observed.actions.shape[1], self.config.longer
        best = found = fit
        limit = np.median(best.misfit) + _MAX_MISFIT_RISE
        for planned in longer:
            if planned > num_steps:
                break
            is_known = np.diag(best.covariance).max(initial=0) < _WELL_KNOWN_STD**2
            # Always try the first: it is cheap, and short windows may claim too much.
            if planned > longer[0] and (is_known or took_s > budget.seconds_left):
                break
            given = observed, states, parameters, found, even_length(num_steps, planned)
            took_s, found = timed(partial(self._in_longer_windows, *given))
            if np.median(found.misfit) > limit:
                break
            best = found
        return best

    def _in_longer_windows(
        self,
        observed: Observed,
        states: np.ndarray,
        parameters: np.ndarray,
        found: ShootingFit,
        window: int,
    ) -> ShootingFit:
        """A fit of windows of `window` steps, from where another one ended."""
        unit = self._begin(parameters)
        unit[self.fitted] = found.unit
        late = [late_unit(steps) for steps, _ in found.late.values()]
        unit[len(self._physics.parameters) :] = late
        improved = self._improved(states, found)
        replay = self._replay(observed, improved)
        longer = self._cut(observed, improved, replay(unit), window)
        # Blurred at first: a motion that ends far away after such a time is no outlier yet.
        count = self.config.longer_iterations
        stages = (Stage(window, count, _EXTENDED_BLUR), Stage(window, count))
        return self._result(*self._descend(longer, unit, stages, replay))

    def fisher_covariance(
        self,
        observed: Observed,
        states: np.ndarray,
        parameters: np.ndarray,
        budget: Budget = NO_LIMIT,
    ) -> tuple[np.ndarray, float]:
        """(P, P) best possible covariance, in unit coordinates, of a fit to such data.

        From the Fisher information at the true (N,) parameters and states, given as in `fit`. The
        windows' initial states are unknown, and FIRST_VARIANCE is the variance between windows.
        Also the share of the windows that the `budget` had time for, evenly spread: the others are
        assumed to tell as much.
        """
        unit, num = self._begin(parameters), len(self.fitted)
        windows = self._cut(observed, states, self._replay(observed, states)(unit))
        count = len(windows.states)
        num_parts = math.ceil(count * self._player.num_worlds / _MOST_WORLDS_AT_ONCE)
        parts = [np.arange(first, count, num_parts) for first in range(min(num_parts, count))]
        eye, num_done = np.eye(len(self._player.fitted)), 0
        total = np.zeros_like(eye)
        for part in budget.each(parts):
            budget.report(_ASKING.format(num_done, count), num_done / count)
            its, num_done = windows.of(part), num_done + len(part)
            none = np.zeros(len(part))
            point = LinearizationPoint(its.states, unit, none, FIRST_VARIANCE)
            information = self._step.information(its, point)
            # As in `combine`: no window tells more than the variance between windows allows.
            shrunk = information @ np.linalg.inv(eye + FIRST_VARIANCE * information)
            total += shrunk.sum(0)
        share = num_done / count
        return np.linalg.inv(total / share + 1e-6 * eye)[:num, :num], share

    def _descend(
        self,
        whole: Windows,
        unit: np.ndarray,
        stages: tuple[Stage, ...],
        replay: ActuatorReplay,
    ) -> tuple[Windows, Stepped]:
        """The last stage's windows, and its last step.

        From unknowns in unit coordinates; `replay`: of the episodes of the windows.
        """
        windows, taken = whole, None
        damping = np.full(len(whole.states), _FIRST_DAMPING)
        no_errors = np.zeros(len(directions(whole.evidence)))
        point = LinearizationPoint(
            whole.states.copy(), unit, damping, FIRST_VARIANCE, common=no_errors
        )
        period = _DERIVED_EVERY_WITH_LAGS if self._lags else DERIVED_EVERY
        for stage in stages:
            windows = whole.first(stage.window)
            point = replace(point, damping=damping, step_scale=1.0)
            slopes = None
            for iteration in range(stage.iterations):
                share = 1.0 if iteration < _FULL_STEPS else 0.5
                share = 0.0 if stage.states_only else share
                if slopes is None or iteration % period == 0:
                    windows = replay.renewed(windows, point.unit)
                    slopes = self._player.differentiate(windows, point)
                taken = self._step.take(windows, point, slopes, share, stage)
                point, slopes = taken.point, slopes._replace(predicted=taken.predicted)
        assert taken is not None, "a descent has an iteration"
        return windows, taken

    def _result(self, windows: Windows, ended: Stepped) -> ShootingFit:
        """Play the windows once more, to see how well they are explained."""
        point, covariance, _, hessian = ended
        num, evidence = len(self.fitted), windows.evidence
        fitted, late = np.split(self._player.fitted, [num])
        full_states, predicted = self._player.play(windows, point.states[None], point.unit[None])
        count = predicted.shape[2] * evidence.num_observations  # of a window
        predicted = predicted + point.common @ directions(evidence)
        return ShootingFit(
            unit=point.unit[fitted],
            covariance=covariance[:num, :num],
            full_states=full_states[0],
            episode=windows.episode,
            step=windows.step,
            misfit=-evidence.log_likelihood(predicted[0]) / count,
            distances=evidence.distances(predicted[0]),
            state_std=self._step.state_std(hessian),
            late=self._found_late(point.unit[late], covariance[num:, num:]),
            beside=beside(evidence, point.common),
        )

    def _cut(
        self,
        observed: Observed,
        states: np.ndarray,
        actuator_states: np.ndarray,
        steps: int | None = None,
    ) -> Windows:
        """By default as long as the last stage's; of any length, as many steps in all."""
        usual = self.config.stages[-1].window
        steps = steps or not_longer(observed.actions.shape[1], usual)
        at_most = self.config.num_windows * usual
        return cut(observed, states, actuator_states, steps, max(1, at_most // steps))

    def _replay(self, observed: Observed, states: np.ndarray) -> ActuatorReplay:
        return ActuatorReplay(self._physics, self._lags, observed.actions, states)

    def _begin(self, parameters: np.ndarray) -> np.ndarray:
        """All unknowns shared by windows, in unit coordinates, for (N,) parameters."""
        return np.concatenate([self._physics.parameters.to_unit(parameters), self._on_time])

    def _found_late(
        self, unit: np.ndarray, covariance: np.ndarray
    ) -> dict[str, tuple[float, float]]:
        """Steps and standard deviation of each kind, from (G,) coordinates and (G, G)."""
        each = [(kind, slice(i, i + 1)) for i, kind in enumerate(self._late)]
        return {kind: steps_late_and_std(unit[at], covariance[at, at]) for kind, at in each}

    def _improved(self, states: np.ndarray, fit: ShootingFit) -> np.ndarray:
        """(E, T + 1, nq + nv) states, replaced by the fit's inside its windows."""
        states = states.copy()
        steps = fit.step[:, None] + np.arange(fit.full_states.shape[1])
        states[fit.episode[:, None], steps] = self._physics.states(fit.full_states)
        return states
