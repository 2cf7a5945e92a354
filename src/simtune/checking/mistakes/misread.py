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
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simtune.checking.mistakes.changes import Change, changes
from simtune.checking.mistakes.dead import dead_encoders
from simtune.fit import OpenLoopReplay, Readings, recorded_loop
from simtune.fit.readings.read_states import ReadStates
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.sensitivity import LONGEST_S, MOST_EPISODES
from simtune.fit.readings.stretches import Stretches, filled, velocities
from simtune.fit.sensitivity import where_analyzed
from simtune.observation import ObservationModel, joints_of
from simtune.simulation import Simulator

_PIECE_S, _FEWEST_STEPS, _PIECES = 0.25, 4, 40
_FEWER = 20  # pieces, where contacts take time
_BEFORE_S = 0.2  # from which what no sensor measures goes along
# By which actions may be late: half a period more of what a controller shakes looks reversed
_LATE_S = (0.0, 0.02, 0.04, 0.06, 0.08)
_SIZES = (1 / 3, 1 / 2, 1.0, 2.0, 3.0)  # of what actions do, in those of the model's first values
_NEARER = (1.3, 1.14, 1.07, 1.03)  # factors from the best of these to one nearer
_MOST_MISTAKES, _MOST_S = 3, 20.0  # seconds for each
_LYING = np.pi / 2
_LOST = 1e6  # a deviation, in a unit of readings, of a world that explodes
# Squared deviations, in those of uniform motion: a reading counts as this many at most, and with so
# few left no mistake is looked for
_MOST, _WELL = 10.0, 0.3
_BETTER, _CLEARLY = 0.9, 0.7  # of what is left without one change, and without all
_AS_WELL = 1.05  # times what the best change leaves: another one may be meant


def misread(readings: Readings, simulator: Simulator, observation: ObservationModel) -> list[str]:
    """A sentence on changes after which short replays leave clearly less, the largest first.

    One is made after the other, as long as any helps. None where all joints follow servos, or where
    a robot begins anywhere and no sensor says so.
    """
    if dead := dead_encoders(readings, simulator, joints_of(observation.sensors)):
        return dead  # what is replayed from these says nothing
    if not (tried := changes(simulator, observation)):
        return []
    nominal, steps = where_analyzed(simulator.space), round(LONGEST_S / simulator.step_s)
    few = slice(MOST_EPISODES)
    readings = Readings(readings.actions[few, :steps], readings.values[few, : steps + 1])
    loop = recorded_loop(simulator, observation, nominal, readings)
    unit = simulator.space.to_unit(nominal)
    if loop.where_starts_show(readings, unit).unseen:
        return []
    if loop.measured.bases:  # which stand: no zero is so far off that they lie or hang
        tried = [change for change in tried if (np.abs(change.shift) < _LYING).all()]
    replays, began_s = _Replays(loop, unit), time.monotonic()
    first = left = replays.left(readings)
    tried = _in_time(tried, time.monotonic() - began_s)
    scale, found = np.ones(readings.values.shape[-1]), dict[str, _Found]()
    for _ in range(_MOST_MISTAKES):
        if left <= _WELL or not tried:
            break
        less, best, others = replays.best(readings, tried)
        least = min(left, replays.left_by_other_sizes(readings))
        first = least if not found else first
        if least <= _WELL or less > _BETTER * least:
            break
        less, best, _ = replays.best(readings, best.nearby())
        before = found.get(best.says, _Found(0.0, []))
        if before.others and not best.shift.any():  # twice is not at all
            del found[best.says]
        else:
            zero = before.zero - float((best.shift / scale).sum())
            found[best.says] = _Found(zero, others)
        readings, scale, left = best.of(readings), scale[best.read] * best.factor, less
    if not found or left > _CLEARLY * first:
        return []
    nearer = f"{math.sqrt(first / left):.2g} times as near to what was read"
    return [f"{_in_words(found)}: then replays of {_PIECE_S:g} s end {nearer}"]


class _Found(NamedTuple):
    """Of a change that helps."""

    zero: float  # what was measured of a joint that is at 0, if it changes a zero
    others: list[str]  # what it says, and what another one does that helps as much


def _in_time(tried: list[Change], takes_s: float) -> list[Change]:
    """Changes that can be tried if each `takes_s`; zeros, which are most, are left out first."""
    for some in (tried, [change for change in tried if not change.shift.any()]):
        if takes_s * len(some) <= _MOST_S:
            return some
    return []


def _in_words(found: Mapping[str, _Found]) -> str:
    """Each change, and what may be meant instead if nothing else says that."""
    told = []
    for says, (zero, others) in found.items():
        instead = [other for other in others if other not in found]
        told.append(", or ".join([says, *instead[:1]]).format(zero=zero))
    return ", and ".join(told)


class _Replays(NamedTuple):
    loop: OpenLoopReplay
    unit: np.ndarray  # (N,)

    def best(self, readings: Readings, tried: Sequence[Change]) -> tuple[float, Change, list[str]]:
        """How much the change leaves that leaves least, itself, and what as good ones say."""
        each = [(self.left(change.of(readings)), change) for change in tried]
        least, best = min(each, key=lambda one: one[0])
        near = _AS_WELL * least
        as_good = [its.says for left, its in each if left < near and not its.shift.any()]
        return least, best, [*dict.fromkeys([best.says, *as_good])]

    def left_by_other_sizes(self, readings: Readings) -> float:
        """What is `left` at the best size of what actions do, which nobody has read.

        What hovers falls or rises unless that is right to a few percent.
        """

        def at(size: float) -> tuple[float, float]:
            return self.left(Readings(size * readings.actions, readings.values)), size

        best = min(map(at, _SIZES))
        for nearer in _NEARER:
            best = min(best, at(best[1] * nearer), at(best[1] / nearer))
        return best[0]

    def left(self, readings: Readings) -> float:
        """Squared deviations of short replays, in those of uniform motion; at the best of a few
        delays. The mean over readings, none of which counts more than `_MOST`.
        """
        step_s = self.loop.physics.simulator.step_s
        delays = sorted({round(late_s / step_s) for late_s in _LATE_S})
        return min(self._left(readings.delayed(late)) for late in delays)

    def _pieces(self, readings: Readings, segments: Segments) -> Stretches:
        """With what no sensor measures as it goes along with the joints read before: wheels that
        roll, under a base at rest, would skid.
        """
        read = self.loop.states_of(readings, self.unit, np.zeros(readings.values.shape[-1]))
        pieces = read.cut(segments)
        if not self.loop.measured.goes_on.any():
            return pieces
        num_rows = round(_BEFORE_S / self.loop.physics.simulator.step_s)
        rows = np.maximum(segments.begin[:, None] + np.arange(-num_rows, 1), 0)
        episode = segments.episode[:, None]
        actions = readings.actions[episode, rows[:, :-1]]
        before = Readings(actions, readings.values[episode, rows])
        states, left = read.states[episode, rows], read.actuator_states[episode, rows]
        led = self.loop.carried(ReadStates(before, states, left, None), self.unit, num_rows)
        is_later = segments.begin >= num_rows
        states = np.where(is_later[:, None], led.states[:, -1], pieces.states)
        return pieces._replace(states=states)

    def _left(self, readings: Readings) -> float:
        steps = max(_FEWEST_STEPS, round(_PIECE_S / self.loop.physics.simulator.step_s))
        num = _FEWER if self.loop.may_touch else _PIECES
        pieces = self._pieces(readings, Segments.evenly(readings, steps, num))
        played = self.loop.play(pieces, pieces.states[None], self.unit[None])[0][0]
        values, times = pieces.values, np.arange(pieces.values.shape[1])
        whole = filled(values)
        uniform = whole[:, :1] + velocities(whole)[:, :1] * times[:, None]
        moved, left = (
            np.nansum(np.square(np.minimum(np.abs(its - values), _LOST)), (0, 1))
            for its in (uniform, played)
        )
        shares = np.minimum(left[moved > 0] / moved[moved > 0], _MOST)
        return float(shares.mean()) if len(shares) else 0.0
