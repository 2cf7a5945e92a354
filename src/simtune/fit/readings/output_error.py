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
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget, timed
from simtune.fit.readings.descent import FIRST_DAMPING, Descent, stepped
from simtune.fit.readings.differences import differentiate, refresh
from simtune.fit.readings.growth import follow
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.output_error_fit import OutputErrorFit, judge
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.replay_objective import Guess, ReplayObjective
from simtune.fit.readings.residuals import spread
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.slopes import Groups, StretchSlopes
from simtune.fit.readings.weak_directions import sharpened
from simtune.observation import assumed_noise

_MORE_ITERATIONS = 5  # with all derivatives computed anew
# Iterations, of which one has all derivatives: what a group's other unknowns do is kept, and
# where large derivatives cancel, as of a thrust and inertias together, a descent would creep
_RENEWED_EVERY = 4


class ReplayStage(NamedTuple):
    iterations: int
    segments: Segments | None = None  # by default whole episodes
    goes_on: bool = False  # whether later stretches go on from those before; see `Stretches`


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
        segments = stage.segments or Segments.evenly(readings)
        if not stage.goes_on and (settled := segments.begin >= loop.unsettled_rows).any():
            segments = segments.of(settled)
        stretches = loop.cut(readings, begin.unit, begin.offsets, segments, stage.goes_on)
        play = partial(loop.play, stretches, stretches.states[None], begin.unit[None])
        played_s, (played, _) = timed(play)
        touches = loop.touches(stretches, begin.unit)
        if near and near.objective.stretches.values.shape != stretches.values.shape:
            near = None  # of a delay that leaves fewer stretches
        left = played[0] + begin.offsets - stretches.values
        noise = spread(left, assumed_noise(loop.sensors))
        start_std = near.objective.start_std if near else loop.measured.start_std(noise, stretches)
        objective = ReplayObjective(
            loop, stretches, begin, start_std, self._finds_offset, self.prior, touches
        )
        begun = Descent(objective, objective.begin(begin), noise, near and near.slopes)
        full_s = self.num_worlds(touches) * played_s

        def cut_again(descent: Descent) -> Descent:
            read = loop.states_of(readings, *descent.guess)
            return descent.with_actuator_states(read.cut(segments).actuator_states)

        depends = stage.goes_on and segments.begin.any() and loop.physics.remembers_actions
        again = cut_again if depends else None
        return self._iterate(begun, stage.iterations, budget, full_s, again)

    def follow(self, readings: Readings, guess: Guess) -> Segments:
        """Whole episodes, or the segments of them that replay can follow."""
        return self.followed(readings, guess).or_whole(readings)

    def followed(self, readings: Readings, guess: Guess) -> Segments:
        """As `follow`; if replay can follow nothing, there are none."""
        loop = self._loop
        read = loop.states_of(readings, guess.unit, guess.offsets)
        return follow(loop, read, guess.unit)[0]

    def num_worlds(self, touches: bool) -> int:
        """How many are played for all derivatives of a descent, if anything touches in it."""
        num = len(self._loop.fitted)  # in a descent; its end takes MOST_WORLDS more
        return 1 + num * (1 + touches) + len(self._loop.measured.start_tangents)

    def _iterate(
        self,
        descent: Descent,
        iterations: int,
        budget: Budget,
        full_s: float = 0.0,
        cut_again: Callable[[Descent], Descent] | None = None,
    ) -> Descent:
        """Iterate; if derivatives near by are known, mostly refresh them by groups of unknowns.

        `full_s`: an iteration with all derivatives, as far as is known. None is begun that would
        not end in time. `cut_again`: with what earlier actions left behind where segments begin,
        which depends on a lag; else the one that a descent begins with would pull it back.
        """
        damping, loop, refreshed_s, is_over = FIRST_DAMPING, self._loop, 0.0, False
        groups = Groups.of(descent.slopes, descent.noise) if descent.slopes else None
        for number in range(1, iterations + 1):
            began_s = time.monotonic()
            is_full = groups is None or is_over or number % _RENEWED_EVERY == 0
            if budget.is_over or (full_s if is_full else refreshed_s) > budget.seconds_left:
                return replace(descent, is_cut_off=True)
            if is_full and number > 1 and cut_again:
                descent = cut_again(descent)
            at = descent.objective.difference_point(descent.point)
            if is_full or descent.slopes is None or groups is None:
                slopes = differentiate(loop, at, one_sided=True)
                groups = Groups.of(slopes, descent.noise)
            else:
                slopes = refresh(loop, at, descent.slopes, groups)
            descent, damping, is_over = stepped(descent, slopes, damping)
            took_s = time.monotonic() - began_s
            full_s, refreshed_s = (took_s, refreshed_s) if is_full else (full_s, took_s)
            # In whole episodes old derivatives may be what holds it up; others are first guesses
            if is_over and (is_full or not descent.objective.stretches.goes_on):
                break
        return descent

    def judge(self, ended: Descent, budget: Budget) -> OutputErrorFit:
        """Uncertainty from full derivatives; if these lead farther down, descend first."""
        began_s = time.monotonic()
        slopes = self._differentiate(ended)
        further, _, is_over = stepped(ended, slopes, FIRST_DAMPING)
        takes_s = time.monotonic() - began_s
        if is_over or takes_s > budget.seconds_left:
            return judge(ended, slopes, budget)
        more = budget.part(budget.seconds_left - takes_s)
        ended = self._iterate(further, _MORE_ITERATIONS, more)
        return judge(ended, self._differentiate(ended), budget)

    def _differentiate(self, ended: Descent) -> StretchSlopes:
        """Full derivatives where a descent ended, also along what readings hardly tell."""
        objective, at = ended.objective, ended.objective.difference_point(ended.point)
        slopes = differentiate(self._loop, at)
        told = objective.equations(ended.point, slopes, ended.noise).information.sum(0)
        return sharpened(self._loop, at, slopes, told)
