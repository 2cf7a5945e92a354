"""Readings of joints that no servo moves: signs, columns, units and zeros that are not the model's.

A servo's command says where its joint should be (`servos`). A motor's says only what pushes it, and
a pendulum has none. So pieces of a quarter of a second are replayed from where readings say that
they begin: as they are, and as if a sign were reversed, two columns exchanged, a unit or a zero
another. A piece that is replayed right ends where it was read; what the model's unknown parameters
leave is less than what such a mistake does. Where a controller balances a robot that is not: its
actions tell little but the deviations that they act against. So a change has to explain more than
actions that do less, or more.
"""

import math
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget, timed
from simtune.checking.mistakes.changes import NEARBY, Change, changes
from simtune.checking.mistakes.dead import dead_encoders
from simtune.checking.mistakes.explained import Explained, in_words
from simtune.checking.mistakes.short_replays import (
    FEW_PIECES,
    PIECE_S,
    SIZES_TRIED,
    ShortReplays,
)
from simtune.checking.sensitivity.parameters import where_analyzed
from simtune.checking.sensitivity.reading_changes import LONGEST_S
from simtune.fit import Readings, recorded_loop, where_starts_show
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.simulation.servos import motors
from simtune.tuning.pace import MOST_REPLAYED

MOST_S = 60.0
_MOST_MISTAKES = 3
_MAX_LIKELY_CHANGES = 10  # that are tried on all pieces, if time is short
_LYING_RAD = np.pi / 2
_WELL_EXPLAINED = 0.3  # of uniform motion's squared deviations: with so few left, no mistake
_ONE_CHANGE_RATIO, _ALL_CHANGES_RATIO = 0.9, 0.7  # of what is left with to without them
_NO_ACTIONS_RATIO = 1.1  # of what is left without actions to with them, if they explain nothing


def misread(
    readings: Readings,
    simulator: Simulator,
    observation: ObservationModel,
    most_s: float = MOST_S,
) -> list[str]:
    """A sentence on changes after which short replays leave clearly less, the largest first.

    If there are none, one says so if motors explain nothing of a motion. None where all joints
    follow servos, or where a robot begins anywhere and no sensor says so. What would take more
    than `most_s` seconds in all is not tried.
    """
    if dead := dead_encoders(readings, simulator, observation.sensors):
        return dead  # what is replayed from these says nothing
    if not (tried := changes(simulator, observation)):
        return []
    budget = Budget(most_s)
    nominal, steps = where_analyzed(simulator.space), round(LONGEST_S / simulator.step_s)
    loop = recorded_loop(simulator, observation, nominal, readings)
    readings = readings.first(steps, MOST_REPLAYED)
    replays = ShortReplays(loop, simulator.space.to_unit(nominal))
    if where_starts_show(loop, readings, replays.unit).unseen:
        return []
    if loop.measured.bases:  # which stand: no zero is so far off that they lie or hang
        tried = [change for change in tried if (np.abs(change.shift) < _LYING_RAD).all()]
    each_s, first = timed(lambda: Explained(replays, readings, replays.left(readings)))
    if first.left <= _WELL_EXPLAINED or SIZES_TRIED * each_s > budget.seconds_left:
        return []
    few_s, _ = timed(lambda: replays.left(readings, FEW_PIECES))
    trying = Trying(budget, each_s, few_s)
    explained = _explained(first, trying.affordable(tried), trying)
    if explained is None:
        return []
    if not explained.found or explained.left > _ALL_CHANGES_RATIO * first.left_at_best_size:
        return _unexplained(first, simulator)
    nearer = f"{math.sqrt(first.left_at_best_size / explained.left):.2g} times as near"
    says = in_words(explained.found)
    return [f"{says}: then replays of {PIECE_S:g} s end {nearer} to what was read"]


class Trying(NamedTuple):
    """How many changes can be tried in the time there is."""

    budget: Budget
    each_s: float  # that one takes
    few_s: float  # with few pieces

    def affordable(self, tried: list[Change]) -> list[Change]:
        """Those of which a few pieces can be replayed: else without zeros, which are most."""
        if len(tried) * self.few_s <= self._one_mistake_s:
            return tried
        return [change for change in tried if not change.shift.any()]

    def likely(self, explained: Explained, tried: list[Change]) -> list[Change]:
        """Those that are tried on all pieces: some of the likeliest if time is short, or none."""
        left_s = self.budget.seconds_left - NEARBY * self.each_s
        if len(tried) * self.each_s <= min(self._one_mistake_s, left_s):
            return tried
        num = int((left_s - len(tried) * self.few_s) / self.each_s)
        if num < 1:
            return []
        return explained.replays.likely(explained.readings, tried, min(num, _MAX_LIKELY_CHANGES))

    @property
    def _one_mistake_s(self) -> float:
        return self.budget.seconds / _MOST_MISTAKES


def _explained(first: Explained, tried: list[Change], trying: Trying) -> Explained | None:
    """After changes that help, made one after the other as long as any does and there is time.

    None if there is no time to try any.
    """
    explained, replays = first, first.replays
    for number in range(_MOST_MISTAKES):
        sizes_s = SIZES_TRIED * trying.each_s
        if explained.left <= _WELL_EXPLAINED or (number and sizes_s > trying.budget.seconds_left):
            break
        if explained.left_at_best_size <= _WELL_EXPLAINED:
            break
        if not (likely := trying.likely(explained, tried)):
            return explained if number else None
        left, best, others = replays.best(explained.readings, likely)
        if left > _ONE_CHANGE_RATIO * explained.left_at_best_size:
            break
        if best.shift.any():
            left, best, _ = replays.best(explained.readings, best.nearby())
        explained = explained.with_change(best, left, others)
    return explained


def _unexplained(first: Explained, simulator: Simulator) -> list[str]:
    """A sentence if motors, all that there is, explain nothing of a motion that readings show."""
    replays, readings, left = first.replays, first.readings, first.left_at_best_size
    all_push = motors(simulator.model).all() and readings.actions.any()
    if not all_push or left <= _WELL_EXPLAINED or not replays.moves(readings):
        return []
    unmoved = replays.left(Readings(0 * readings.actions, readings.values))
    if unmoved > _NO_ACTIONS_RATIO * left:
        return []
    return [
        f"replays of {PIECE_S:g} s explain little of what was read, and no less without any "
        "actions: these do not seem to be what the model's motors are told, forces or torques in "
        "its units. Targets, steps of a hand and what a policy says are for a controller: log what "
        "that one tells the motors"
    ]
