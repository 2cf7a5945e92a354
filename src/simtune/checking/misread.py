"""Readings of joints that no servo moves: signs, columns, units and zeros that are not the model's.

A servo's command says where its joint should be (`servos`). A motor's says only what pushes it, and
a pendulum has none. So pieces of a quarter of a second are replayed from where readings say that
they begin: as they are, and as if a sign were reversed, two columns exchanged, a unit or a zero
another. A piece that is replayed right ends where it was read; what the model's unknown parameters
leave is less than what such a mistake does.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.commands import servos_of
from simtune.fit import OpenLoopReplay, Readings
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.stretches import filled, velocities
from simtune.fit.sensitivity import where_analyzed
from simtune.observation import JointSensor, ObservationModel, columns_of
from simtune.simulation import Simulator
from simtune.simulation.servos import motors

_PIECE_S, _FEWEST_STEPS, _PIECES = 0.25, 4, 40
_LATE_S = (0.0, 0.03, 0.08)  # by which actions may be late
_EIGHTH = np.pi / 4  # of a turn, by which zeros are tried
_FINER = 3  # zeros to both sides of the best one
_MOST_COLUMNS = 8  # of which any two may be exchanged; of more, neighbours
_MOST_MISTAKES = 3
_LOST = 1e6  # a deviation, in a unit of readings, of a world that explodes
_WELL = 0.3  # of the squared deviations left: no mistake is looked for
_BETTER = 0.9  # of what is left without a change
_CLEARLY, _AT_MOST = 0.7, 0.7  # ... without all changes; and in all
_UNITS = {"rad": ("degrees", "deg", 180 / np.pi), "m": ("mm", "mm", 1000.0)}


class Change(NamedTuple):
    """What readings (E, T + 1, D) or actions (E, T, A) may be instead."""

    says: str
    read: np.ndarray  # (D,) columns to take
    factor: np.ndarray  # (D,) on them
    shift: np.ndarray  # (D,) added to them
    push: np.ndarray  # (A,) factor on actions

    def of(self, readings: Readings) -> Readings:
        values = readings.values[..., self.read] * self.factor + self.shift
        return Readings(readings.actions * self.push, values)

    def nearby(self) -> list["Change"]:
        """With zeros around this one's."""
        steps = np.arange(-_FINER, _FINER + 1) / (2 * _FINER)
        return [self._replace(shift=self.shift + s * _EIGHTH * (self.shift != 0)) for s in steps]


def misread(readings: Readings, simulator: Simulator, observation: ObservationModel) -> list[str]:
    """A sentence on changes after which short replays leave clearly less, the largest first.

    One is made after the other, as long as any helps. None where all joints follow servos, or where
    a robot begins anywhere and no sensor says so.
    """
    nominal = where_analyzed(simulator.space)
    loop = OpenLoopReplay.of(simulator, observation, nominal)
    unit, found = simulator.space.to_unit(nominal), list[str]()
    changes = list(_changes(simulator, loop.sensors))
    if not changes or loop.where_starts_show(readings, unit).unseen:
        return []
    replays = _Replays(loop, unit)
    first = left = replays.left(readings)
    while len(found) < _MOST_MISTAKES and left > _WELL:
        less, best = replays.best(readings, changes)
        if less > _BETTER * left:
            break
        if best.shift.any():
            less, best = replays.best(readings, [best, *best.nearby()])
        found.append(best.says.format(zero=-best.shift.sum()))
        readings, left = best.of(readings), less
    if not found or left > min(_AT_MOST, _CLEARLY * first):
        return []
    return [
        f"{', and '.join(found)}: of how readings deviate from uniform motion, replays of "
        f"{_PIECE_S:g} s would leave {left:.0%}, and now leave {first:.0%}"
    ]


class _Replays(NamedTuple):
    loop: OpenLoopReplay
    unit: np.ndarray  # (N,)

    def best(self, readings: Readings, changes: Sequence[Change]) -> tuple[float, Change]:
        """The change that leaves least, and how much."""
        left = [self.left(change.of(readings)) for change in changes]
        return min(left), changes[int(np.argmin(left))]

    def left(self, readings: Readings) -> float:
        """Share of squared deviations from uniform motion that short replays leave, at the best
        of a few delays; the mean over readings, none of which counts more than once.
        """
        step_s = self.loop.physics.simulator.step_s
        delays = sorted({round(late_s / step_s) for late_s in _LATE_S})
        return min(self._left(readings.delayed(late)) for late in delays)

    def _left(self, readings: Readings) -> float:
        steps = max(_FEWEST_STEPS, round(_PIECE_S / self.loop.physics.simulator.step_s))
        none = np.zeros(readings.values.shape[-1])
        segments = Segments.evenly(readings, steps, _PIECES)
        pieces = self.loop.states_of(readings, self.unit, none).cut(segments)
        played = self.loop.play(pieces, pieces.states[None], self.unit[None])[0][0]
        values, times = pieces.values, np.arange(steps + 1)
        whole = filled(values)
        uniform = whole[:, :1] + velocities(whole)[:, :1] * times[:, None]
        moved, left = (
            np.nansum(np.square(np.minimum(np.abs(its - values), _LOST)), (0, 1))
            for its in (uniform, played)
        )
        shares = np.minimum(left[moved > 0] / moved[moved > 0], 1.0)
        return float(shares.mean()) if len(shares) else 0.0


def _changes(simulator: Simulator, sensors: Sequence[JointSensor]) -> Iterator[Change]:
    """All that are tried. Not of joints whose servos' commands say more."""
    columns = columns_of(sensors)
    num, num_actions = len(columns), simulator.num_actions
    same = Change("", np.arange(num), np.ones(num), np.zeros(num), np.ones(num_actions))
    has_servo = [servo is not None for servo in servos_of(simulator, sensors)]
    free = [
        column
        for column, (sensor, _) in enumerate(columns)
        if not has_servo[column] and not sensor.is_velocity
    ]
    names = [sensor.joints[column] for sensor, column in columns]
    for action in _pushes(simulator):
        name, push = simulator.action_mapping.names[action], same.push.copy()
        push[action] = -1.0
        yield same._replace(says=f"{name} seems to push the other way", push=push)
    for column in free:
        is_its = np.array([name == names[column] for name in names])  # its velocity's, too
        says = f"{names[column]} seems to be read with a reversed sign"
        yield same._replace(says=says, factor=np.where(is_its, -1.0, 1.0))
    for one, other in combinations(free, 2):
        if len(free) <= _MOST_COLUMNS or free.index(other) == free.index(one) + 1:
            read = same.read.copy()
            read[[one, other]] = other, one
            says = f"the columns of {names[one]} and {names[other]} seem to be exchanged"
            yield same._replace(says=says, read=read)
    for sensor in {columns[column][0].name: columns[column][0] for column in free}.values():
        its = np.array([other is sensor for other, _ in columns])
        yield from _other_units(same, sensor, its)
    for column in free:
        if columns[column][0].unit == "rad":
            yield from _other_zeros(same, column, names[column], columns[column][0].name)


def _pushes(simulator: Simulator) -> list[int]:
    """Actions of motors that push both ways."""
    model, mapping = simulator.model, simulator.action_mapping
    pushes = {model.actuator(i).name or f"actuator {i}" for i in np.flatnonzero(motors(model))}
    both_ways = zip(mapping.names, mapping.range, strict=True)
    return [
        i for i, (name, (low, high)) in enumerate(both_ways) if name in pushes and low < 0 < high
    ]


def _other_units(same: Change, sensor: JointSensor, its: np.ndarray) -> Iterator[Change]:
    """Of a sensor's columns, (D,) bool: degrees or mm, or not these."""
    other, key, factor = _UNITS[sensor.unit]
    if (sensor.factor == 1).all():
        says = f'sensor {sensor.name} seems to say {other} (unit = "{key}")'
        yield same._replace(says=says, factor=np.where(its, 1 / factor, 1.0))
    elif np.allclose(sensor.factor, factor):
        says = f"sensor {sensor.name} seems to say {sensor.unit}, not {other}"
        yield same._replace(says=says, factor=np.where(its, factor, 1.0))


def _other_zeros(same: Change, column: int, joint: str, sensor: str) -> Iterator[Change]:
    for number in (1, -1, 2, -2, 3, -3, 4):
        shift = same.shift.copy()
        shift[column] = number * _EIGHTH
        says = (
            f"the zero of {joint} seems to be {{zero:.2f}} rad from the model's (offset of sensor "
            f"{sensor}, measured − true)"
        )
        yield same._replace(says=says, shift=shift)
