"""What readings and actions may be instead: other signs, columns, units and zeros."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.commands import servos_of
from simtune.fit import Readings
from simtune.observation import JointSensor, ObservationModel, columns_of
from simtune.simulation import Simulator
from simtune.simulation.other_actions import exchanged, other_actions, pairs
from simtune.units import OTHER_UNITS

ZERO = "\0"  # in what a change says: how far a zero is elsewhere; in no name, unlike braces
_EIGHTH_RAD = np.pi / 4  # of a turn, by which zeros are tried
_FINER_ZEROS = 3  # to both sides of the best one
NEARBY = 2 * _FINER_ZEROS + 1


class Change(NamedTuple):
    """A change of readings (E, T + 1, D), or of actions (E, T, A)."""

    says: str  # perhaps with ZERO in it
    read: np.ndarray  # (D,) columns to take
    factor: np.ndarray  # (D,) on them
    shift: np.ndarray  # (D,) added to them
    act: np.ndarray  # (A,) actions to take
    push: np.ndarray  # (A,) factor on them

    def of(self, readings: Readings) -> Readings:
        values = readings.values[..., self.read] * self.factor + self.shift
        return Readings(readings.actions[..., self.act] * self.push, values)

    def nearby(self) -> list["Change"]:
        """`NEARBY` of them, with zeros around this one's; itself among them."""
        steps = np.arange(-_FINER_ZEROS, _FINER_ZEROS + 1) / (2 * _FINER_ZEROS)
        return [
            self._replace(shift=self.shift + s * _EIGHTH_RAD * (self.shift != 0)) for s in steps
        ]


def changes(simulator: Simulator, observation: ObservationModel) -> list[Change]:
    """All that are tried. Not of joints whose servos' commands say more."""
    sensors = observation.sensors
    columns, num_actions = columns_of(sensors), simulator.num_actions
    num, names = len(columns), [sensor.joints[column] for sensor, column in columns]
    each, all_actions = np.arange(num), np.arange(num_actions)
    same = Change("", each, np.ones(num), np.zeros(num), all_actions, np.ones(num_actions))
    servos = servos_of(simulator, sensors)
    free = [
        column
        for column, (sensor, _) in enumerate(columns)
        if servos[column] is None and sensor.is_position
    ]
    found = [same._replace(**action._asdict()) for action in other_actions(simulator)]
    for column in free:
        is_its = np.array([name == names[column] for name in names])  # its velocity's, too
        says = f"{names[column]} seems to be read with a reversed sign"
        found.append(same._replace(says=says, factor=np.where(is_its, -1.0, 1.0)))
    for one, other in pairs(free):
        says = f"the columns of {names[one]} and {names[other]} seem to be exchanged"
        found.append(same._replace(says=says, read=exchanged(same.read, one, other)))
    for sensor in {columns[column][0].name: columns[column][0] for column in free}.values():
        found += _other_units(same, sensor, np.array([other is sensor for other, _ in columns]))
    for column in free:
        if columns[column][0].unit == "rad":
            found += _other_zeros(same, column, names[column], columns[column][0].name)
    return found


def _other_units(same: Change, sensor: JointSensor, is_its: np.ndarray) -> Iterator[Change]:
    """Of a sensor's columns, (D,) bool: degrees or mm, or not these."""
    factor, other, key = OTHER_UNITS[sensor.unit]
    if (sensor.factor == 1).all():
        says = f'sensor {sensor.name} seems to say {other} (unit = "{key}")'
        yield same._replace(says=says, factor=np.where(is_its, 1 / factor, 1.0))
    elif np.allclose(sensor.factor, factor):
        says = f"sensor {sensor.name} seems to say {sensor.unit}, not {other}"
        yield same._replace(says=says, factor=np.where(is_its, factor, 1.0))


def _other_zeros(same: Change, column: int, joint: str, sensor: str) -> Iterator[Change]:
    says = (
        f"the zero of {joint} seems to be {ZERO} rad from the model's (measured − true; "
        f"offset of sensor {sensor}, in its own unit)"
    )
    for number in (1, -1, 2, -2, 3, -3, 4):
        yield same._replace(says=says, shift=number * _EIGHTH_RAD * (same.read == column))
