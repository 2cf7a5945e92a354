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
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from simtune.checking.mistakes.changes import Change, changes
from simtune.checking.mistakes.dead import dead_encoders
from simtune.checking.mistakes.short_replays import FEW_PIECES, PIECE_S, ShortReplays
from simtune.fit import Readings, recorded_loop, where_starts_show
from simtune.fit.readings.sensitivity import LONGEST_S, MOST_EPISODES
from simtune.fit.sensitivity import where_analyzed
from simtune.observation import ObservationModel, joints_of
from simtune.simulation import Simulator
from simtune.simulation.servos import motors

_MOST_MISTAKES, _MOST_S = 3, 20.0  # seconds for each
_LYING = np.pi / 2
_WELL = 0.3  # of squared deviations of uniform motion: with so few left no mistake is looked for
_BETTER, _CLEARLY = 0.9, 0.7  # of what is left without one change, and without all
_AS_LITTLE = 1.1  # times what is left with actions: so much is without, if they explain nothing


def misread(readings: Readings, simulator: Simulator, observation: ObservationModel) -> list[str]:
    """A sentence on changes after which short replays leave clearly less, the largest first.

    If there are none, one says so if motors explain nothing of a motion. None where all joints
    follow servos, or where a robot begins anywhere and no sensor says so.
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
    if where_starts_show(loop, readings, unit).unseen:
        return []
    if loop.measured.bases:  # which stand: no zero is so far off that they lie or hang
        tried = [change for change in tried if (np.abs(change.shift) < _LYING).all()]
    replays, began_s = ShortReplays(loop, unit), time.monotonic()
    left = replays.left(readings)
    takes_s = time.monotonic() - began_s
    if left <= _WELL:
        return []
    changed = _changed(replays, readings, tried, left, takes_s)
    return changed or _unexplained(replays, readings, simulator)


def _changed(
    replays: ShortReplays, readings: Readings, tried: list[Change], left: float, takes_s: float
) -> list[str]:
    """A sentence on changes that help, made one after the other as long as any does.

    `left`: of the readings as they are, in `takes_s` seconds.
    """
    first = left
    tried = _in_time(tried, takes_s * FEW_PIECES / replays.num_pieces)
    scale, found = np.ones(readings.values.shape[-1]), dict[str, _Found]()
    for _ in range(_MOST_MISTAKES):
        if left <= _WELL:
            break
        are_many = takes_s * len(tried) > _MOST_S
        likely = replays.likely(readings, tried) if are_many else tried
        less, best, others = replays.best(readings, likely)
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
    return [f"{_in_words(found)}: then replays of {PIECE_S:g} s end {nearer}"]


def _unexplained(replays: ShortReplays, readings: Readings, simulator: Simulator) -> list[str]:
    """A sentence if motors, all that there is, explain nothing of a motion that readings show."""
    all_push = motors(simulator.model).all() and readings.actions.any()
    if not all_push or not replays.moves(readings):
        return []
    left = replays.left_by_other_sizes(readings)
    unmoved = replays.left(Readings(0 * readings.actions, readings.values))
    if left <= _WELL or unmoved > _AS_LITTLE * left:
        return []
    return [
        f"replays of {PIECE_S:g} s explain little of what was read, and no less without any "
        "actions: these do not seem to be what the model's motors are told, forces or torques in "
        "its units. Targets, steps of a hand and what a policy says are for a controller: log what "
        "that one tells the motors"
    ]


class _Found(NamedTuple):
    """Of a change that helps."""

    zero: float  # what was measured of a joint that is at 0, if it changes a zero
    others: list[str]  # what it says, and what another one does that helps as much


def _in_time(tried: list[Change], takes_s: float) -> list[Change]:
    """Changes that can be tried if each `takes_s`: else without zeros, which are most."""
    if takes_s * len(tried) <= _MOST_S:
        return tried
    return [change for change in tried if not change.shift.any()]


def _in_words(found: Mapping[str, _Found]) -> str:
    """Each change, and what may be meant instead if nothing else says that."""
    told = []
    for says, (zero, others) in found.items():
        instead = [other for other in others if other not in found]
        told.append(", or ".join([says, *instead[:1]]).format(zero=zero))
    return ", and ".join(told)
