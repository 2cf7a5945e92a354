"""Output-error fit: parameters with which an open-loop replay predicts the readings.

Later readings never correct the replay (Ljung 1999, System Identification, Sec. 3.2 and 7.2), so
the fit minimises what open-loop replay is judged by. Over parameters θ, offsets b of the sensors
and the initial states x_w of W stretches, the cost is

    Σ_w Σ_t Σ_d ρ(r_wtd / σ_d) + ½ Σ_w ‖x_w ⊖ x̄_w(b)‖²_S + ½ ‖θ − θ̄‖²_Π + ½ ‖b‖²_B
    r_wtd = h_d(x_w(t; θ)) + b_d − y_wtd

with Huber's ρ, initial states x̄_w(b) from the readings less their offsets, and weak priors of
parameters, Π around the first guess, and of offsets, B. A lateness of the readings moves x̄_w, too.
σ_d is the rms residual of each reading, re-estimated in each step: a joint counts by how well it
can be explained. Gauss-Newton, with Levenberg's damping and initial states eliminated (Schur).

No simulator is exact, so residuals are correlated, for about a second. Each counts as 1/τ_d of a
measurement, with τ_d its integrated autocorrelation time.
"""

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit.elimination import NormalEquations
from simtune.fit.lateness import Lateness
from simtune.fit.readings.differences import differentiate, refresh
from simtune.fit.readings.growth import follow
from simtune.fit.readings.normal_equations import explained_by_starts, jackknife, jackknife_std
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.replay_objective import Guess, Point, ReplayObjective
from simtune.fit.readings.residuals import correlation_times, spread
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.slopes import Groups, StretchSlopes
from simtune.fit.readings.stretches import Readings
from simtune.observation import assumed_noise

_FIRST_DAMPING = 1e-2
_DAMPING = (1e-4, 1e6)
_TRIED = 7  # steps, each with more damping, before the descent ends
_ENOUGH = 1e-4  # share of the cost that a step must gain for another one to follow
_FEWEST = 2.0  # effective observations per reading
_PARTS = 5  # of a single stretch, each left out in turn
_MORE_ITERATIONS = 5  # with all derivatives computed anew


class ReplayStage(NamedTuple):
    iterations: int
    steps: int | None = None  # of a stretch; by default the whole episode
    at_most: int | None = None  # limit on the number of stretches
    segments: Segments | None = None  # if given, `steps` and `at_most` are ignored

    def segments_of(self, readings: Readings) -> Segments:
        return self.segments or Segments.evenly(readings, self.steps, self.at_most)


@dataclass(frozen=True)
class Descent:
    """Where Gauss-Newton is or ended, with the last derivatives."""

    objective: ReplayObjective
    point: Point
    noise: np.ndarray  # (D,) root mean square of the residuals
    slopes: StretchSlopes | None = None

    @property
    def unit(self) -> np.ndarray:
        """(N,) parameters in unit coordinates; those not fitted are unchanged."""
        return self.point.unit

    @property
    def begun(self) -> np.ndarray:
        """(N,) where it began."""
        return self.objective.cut_at.unit

    @property
    def guess(self) -> Guess:
        """Start of another descent."""
        return Guess(self.point.unit, self.point.offsets)

    @property
    def log_rms(self) -> float:
        """Mean logarithm of the residuals' rms over all readings: lower is better."""
        known = np.isfinite(self.objective.stretches.values).sum((0, 1))
        return float(np.average(np.log(self.noise), weights=known))


@dataclass(frozen=True)
class OutputErrorFit:
    """Estimate and uncertainty; P parameters, D readings."""

    unit: np.ndarray  # (N,) parameters in unit coordinates; those not fitted are unchanged
    covariance: np.ndarray  # (P, P) in unit coordinates
    offsets: np.ndarray  # (D,) measured − simulated
    noise: np.ndarray  # (D,) root mean square of the residuals
    start: np.ndarray | None  # (S,) full state where the first episode begins, if it was replayed
    late_steps: tuple[float, float]  # lateness of readings, and its standard deviation
    # (P, D) shares of readings in what each parameter changes, at usual noise; rows sum to 1
    shares: np.ndarray


class OutputErrorMethod:
    """Fits one simulator to readings by the output-error method."""

    def __init__(self, loop: OpenLoopReplay, finds_offset: np.ndarray, prior: np.ndarray):
        """`finds_offset`: (D,) bool; `prior`: (N,) first guess, in unit coordinates."""
        self._loop, self._finds_offset, self.prior = loop, finds_offset, prior
        self.sensors, self.has_lateness = loop.sensors, loop.lateness is not None

    def descend(
        self,
        readings: Readings,
        begin: Guess,
        stage: ReplayStage,
        budget: Budget,
        near: Descent | None = None,
    ) -> Descent:
        """Descend from a first guess; `budget` may end it early.

        `near`: a descent of the same stage, whose derivatives are used at first.
        """
        loop = self._loop
        segments = stage.segments_of(readings)
        stretches = loop.states_of(readings, begin.unit, begin.offsets).cut(
            segments, goes_on=stage.segments is not None
        )
        began_s = time.monotonic()
        played, _ = loop.play(stretches, stretches.states[None], begin.unit[None])
        derived_s = self.num_worlds * (time.monotonic() - began_s)
        left = played[0] + begin.offsets - stretches.values
        noise = spread(left, assumed_noise(loop.sensors))
        if near:
            start_std = near.objective.start_std
        else:
            start_std = loop.measured.start_std(noise, stretches.values)
        objective = ReplayObjective(
            loop, stretches, begin, start_std, self._finds_offset, self.prior
        )
        begun = Descent(objective, objective.begin(begin), noise, near and near.slopes)
        return self._iterate(begun, stage.iterations, budget, derived_s if near is None else 0.0)

    def follow(self, readings: Readings, guess: Guess) -> Segments:
        """Whole episodes, or the segments of them that replay can follow."""
        loop = self._loop
        return follow(loop, loop.states_of(readings, guess.unit, guess.offsets), guess.unit)

    @property
    def num_worlds(self) -> int:
        """How many are played for all derivatives."""
        num = len(self._loop.fitted)
        return 1 + num * (1 + self._loop.may_touch) + len(self._loop.measured.start_tangents)

    def _iterate(
        self, descent: Descent, iterations: int, budget: Budget, takes_s: float = 0.0
    ) -> Descent:
        """Iterate; if derivatives near by are known, refresh them by groups of unknowns.

        `takes_s`: an iteration, as far as is known. None is begun that would not end in time.
        """
        damping, loop = _FIRST_DAMPING, self._loop
        groups = Groups.of(descent.slopes, descent.noise) if descent.slopes else None
        for _ in range(iterations):
            began_s = time.monotonic()
            if budget.is_over or takes_s > budget.seconds_left:
                break
            at = descent.objective.difference_point(descent.point)
            if descent.slopes is None or groups is None:
                slopes = differentiate(loop, at, one_sided=True)
                groups = Groups.of(slopes, descent.noise)
            else:
                slopes = refresh(loop, at, descent.slopes, groups)
            descent, damping, is_over = _stepped(replace(descent, slopes=slopes), damping)
            takes_s = time.monotonic() - began_s
            if is_over:
                break
        return descent

    def judge(self, ended: Descent, budget: Budget) -> OutputErrorFit:
        """Uncertainty from full derivatives; if these lead farther down, descend first."""
        began_s = time.monotonic()
        slopes = self._differentiate(ended)
        further, _, is_over = _stepped(replace(ended, slopes=slopes), _FIRST_DAMPING)
        takes_s = time.monotonic() - began_s
        if is_over or takes_s > budget.seconds_left:
            return self._conclude(ended, slopes)
        more = budget.part(budget.seconds_left - takes_s)
        ended = self._iterate(further, _MORE_ITERATIONS, more)
        return self._conclude(ended, self._differentiate(ended))

    def _differentiate(self, ended: Descent) -> StretchSlopes:
        """Full derivatives where a descent ended."""
        return differentiate(self._loop, ended.objective.difference_point(ended.point))

    def _conclude(self, ended: Descent, slopes: StretchSlopes) -> OutputErrorFit:
        """Estimate with its covariance, each residual counting as 1/τ of a measurement."""
        objective, point, num = ended.objective, ended.point, len(self._loop.fitted)
        residuals = objective.residuals(point, slopes.predicted)
        noise, times = objective.noise(residuals), correlation_times(residuals)
        count = np.maximum(np.isfinite(residuals).sum((0, 1)) / times, _FEWEST)
        # Degrees of freedom of each column: its own offset, its share of the parameters, and what
        # initial states explain of it
        spent = self._finds_offset + num / len(noise)
        spent += explained_by_starts(slopes.by_start, residuals, noise * np.sqrt(times))
        unsure = np.sqrt(times * count / np.maximum(count - spent, count / 4))
        equations = objective.equations(point, slopes, noise * unsure)
        information, _ = objective.with_prior(equations, point)
        covariance = np.linalg.inv(information)
        scattered = _scatter(ended, slopes, noise * unsure, equations)[:num]
        std = np.sqrt(np.diag(covariance))[:num]
        wider = np.maximum(scattered / std, 1.0)
        covariance = covariance[:num, :num] * np.outer(wider, wider)
        own, size = num - (self._loop.lateness is not None), len(self._loop.physics.parameters)
        is_known = np.isfinite(residuals)[:, None]
        # Not at `noise`: a reading that the model explains badly would seem to show little
        seen = slopes.by_parameter[:, :own] * is_known / assumed_noise(self._loop.sensors)
        shown = np.square(seen).sum((0, 2))  # (P, D)
        return OutputErrorFit(
            unit=point.unit[:size],
            covariance=covariance[:own, :own],
            offsets=point.offsets,
            noise=noise,
            start=objective.play(point)[1][0] if objective.begins_at_first else None,
            late_steps=Lateness.found(point.unit[size:], covariance[own:, own:]),
            shares=shown / np.maximum(shown.sum(1, keepdims=True), 1e-300),
        )


def _scatter(
    ended: Descent, slopes: StretchSlopes, noise: np.ndarray, equations: NormalEquations
) -> np.ndarray:
    """(P + offsets,) standard deviations by leaving out episodes, or stretches of a single one.

    Or parts of a single stretch.
    """
    objective, point, episode = ended.objective, ended.point, ended.objective.stretches.episode
    if len(episode) > 1:
        alone = np.arange(len(episode)) if (episode == episode[0]).all() else episode
        return jackknife(*equations.by_group(alone), objective.with_prior(equations, point)[0])
    moved = []
    for part in np.array_split(np.arange(slopes.predicted.shape[1]), _PARTS):
        left = objective.equations(point, slopes, noise, part)
        moved.append(-np.linalg.solve(*objective.with_prior(left, point)))
    return jackknife_std(np.array(moved))


def _stepped(start: Descent, damping: float) -> tuple[Descent, float, bool]:
    """One Gauss-Newton step; the next damping, and whether the gain is too small to go on."""
    objective, slopes, noise = start.objective, start.slopes, start.noise
    assert slopes is not None
    equations = objective.equations(start.point, slopes, noise)
    shared = objective.with_prior(equations, start.point)
    before = objective.cost(start.point, objective.residuals(start.point, slopes.predicted), noise)
    if equations.promised(*shared) < _ENOUGH * before:
        return start, damping, True
    for _ in range(_TRIED):
        point = objective.step(start.point, equations, damping)
        residuals = objective.residuals(point, objective.play(point)[0])
        gain = before - objective.cost(point, residuals, noise)
        damping = float(np.clip(damping * (0.2 if gain > 0 else 8), *_DAMPING))
        if gain > 0:
            is_over = gain < _ENOUGH * before
            return replace(start, point=point, noise=objective.noise(residuals)), damping, is_over
    return start, damping, True
