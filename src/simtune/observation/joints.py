"""What joints measure, in the units in which it was recorded: positions, velocities, torques."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from simtune.between_rows import read_nearest
from simtune.errors import InputError
from simtune.observation.joint_readings import JointReadings

Quantity = Literal["position", "velocity", "torque"]
_STATE_PREFIX = "observation.state."  # of a feature in a LeRobotDataset
_DEFAULT_NOISE_STD = 1e-3  # rad, m, or those per second: for an encoder of unknown noise
_ROUNDING_ROWS = 1e-6  # by which a latency of whole rows may miss them


@dataclass(frozen=True, kw_only=True)
class JointSensor:
    """Measures D joints, each by one number.

    Trajectories hold its readings, (T + 1, D), under its name.
    """

    name: str
    columns: tuple[str, ...]  # (D,) in recordings, or one that stands for all
    joints: tuple[str, ...]  # (D,)
    places: np.ndarray  # (D,) indices into a state's positions, or velocities; torques are as these
    # (G,) readings behind a joint's backlash, which adds to them, and (G,) the same indices for it
    geared: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    play_places: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    quantity: Quantity = "position"  # torque: what actuators exert on the joint
    unit: str = "rad"  # of readings in a fit; one for all
    # (D,) recorded = `shift` + `factor` · reading
    factor: np.ndarray
    shift: np.ndarray
    # Standard deviation, in `unit`, of all or (D,) of each; None: unknown
    noise: float | np.ndarray | None = None
    offset: np.ndarray | None = None  # (D,) measured − true, in `unit`; None: unknown
    latency_s: float = 0.0  # by which a reading is older than its picture
    endless: np.ndarray | None = None  # (D,) bool: positions of hinges without limits

    @property
    def is_position(self) -> bool:
        return self.quantity == "position"

    @property
    def is_velocity(self) -> bool:
        return self.quantity == "velocity"

    @property
    def is_torque(self) -> bool:
        """Whether a state alone does not determine it, but the action that led there."""
        return self.quantity == "torque"

    @property
    def column_names(self) -> tuple[str, ...]:
        """(D,) names of the numbers in a written recording."""
        if len(self.columns) != self.size:
            return self.joints
        return tuple(column.removeprefix(_STATE_PREFIX) for column in self.columns)

    @property
    def size(self) -> int:
        return len(self.joints)

    @property
    def finds_offsets(self) -> bool:
        return self.offset is None and self.is_position

    @property
    def _known_offset(self) -> np.ndarray:
        return np.zeros(self.size) if self.offset is None else self.offset

    @property
    def noise_or_usual(self) -> float | np.ndarray:
        return _DEFAULT_NOISE_STD if self.noise is None else self.noise

    @property
    def periods(self) -> np.ndarray:
        """(D,) a turn, as recorded, of endless hinges: many encoders begin again after it.

        Infinite for other joints. Simulated joints count on.
        """
        is_endless = np.zeros(self.size, bool) if self.endless is None else self.endless
        return np.where(is_endless, 2 * np.pi * np.abs(self.factor), np.inf)

    def from_recorded(self, recorded: np.ndarray, step_s: float) -> np.ndarray:
        """(T + 1, D) readings in `unit`, at the times of the frames; NaN: unknown.

        `recorded`: (T + 1, D) as recorded, one per step of `step_s` seconds, and counted on where
        an encoder began again after one of its `periods`. Raises InputError if no reading of a
        joint is left after its latency.
        """
        readings = self._begun((recorded - self.shift) / self.factor - self._known_offset)
        if not self.latency_s:
            return readings
        on_time = advanced(readings, self.latency_s / step_s)
        if (lost := np.isfinite(readings).any(0) & ~np.isfinite(on_time).any(0)).any():
            raise InputError(
                f"sensor {self.name}: no reading of {self.joints[int(lost.argmax())]} is left of "
                f"{len(readings)} rows, {step_s:.3g} s apart, when taken {self.latency_s:g} s "
                "earlier; expected readings for longer than that: mend latency_s, or drop the "
                "episode"
            )
        return on_time

    def to_recorded(self, readings: np.ndarray) -> np.ndarray:
        """(..., D) the inverse, except for the latency."""
        return (readings + self._known_offset) * self.factor + self.shift

    def observe(self, batch: Any) -> np.ndarray:
        """(n, D) noise-free, of n simulated worlds' present state; torques of their last step."""
        if self.is_torque:
            return batch.bind("qfrc_actuator")[:, self.places]
        values = batch.qvel if self.is_velocity else batch.qpos
        read = values[:, self.places]
        read[:, self.geared] += values[:, self.play_places]
        return read

    def measure(self, observed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(..., T + 1, D) readings with noise."""
        return self._begun(observed + self.noise_or_usual * rng.normal(size=observed.shape))

    def _begun(self, readings: np.ndarray) -> np.ndarray:
        """(..., T + 1, D) with torques unknown in the first row: which action led there?"""
        if self.is_torque:
            readings[..., 0, :] = np.nan
        return readings

    def evidence(self, readings: np.ndarray) -> JointReadings:
        """Of (E, T + 1, D) readings."""
        return JointReadings.of(
            self.name,
            self.unit,
            readings,
            self.noise_or_usual,
            self.finds_offsets,
            self.is_torque,
        )


def advanced(values: np.ndarray, steps: float) -> np.ndarray:
    """(T, D): row t is what `values` are `steps` rows later; NaN beyond the ends, and in gaps.

    Each reading is moved to the row nearest to its new time, so an encoder slower than rows has as
    many as before; see `read_nearest`.
    """
    rows = np.arange(len(values), dtype=float)
    moved = [read_nearest(rows + steps, rows, column, _ROUNDING_ROWS) for column in values.T]
    return np.stack(moved, -1)


def measured_places(sensors: Iterable[JointSensor]) -> list[int]:
    """Indices of the positions that some sensor reads, ascending."""
    return sorted({int(p) for s in sensors if s.is_position for p in s.places})


def columns_of(sensors: Sequence[JointSensor]) -> list[tuple[JointSensor, int]]:
    """(D,) of all readings side by side: the sensor, and the column among its own."""
    return [(sensor, column) for sensor in sensors for column in range(len(sensor.joints))]


def by_column(
    sensors: Sequence[JointSensor], values: np.ndarray
) -> Iterator[tuple[JointSensor, int, np.ndarray]]:
    """As `columns_of`, with the (E, T + 1) readings of (E, T + 1, D) in each column."""
    for (sensor, column), its in zip(columns_of(sensors), np.moveaxis(values, -1, 0), strict=True):
        yield sensor, column, its


def units_of(sensors: Sequence[JointSensor]) -> tuple[str, ...]:
    """(D,) units of all readings side by side."""
    return tuple(sensor.unit for sensor, _ in columns_of(sensors))


def assumed_noise(sensors: Sequence[JointSensor]) -> np.ndarray:
    """(D,) standard deviations of all readings, declared or usual."""
    return np.concatenate([np.full(sensor.size, sensor.noise_or_usual) for sensor in sensors])


def declared_noise(sensors: Sequence[JointSensor]) -> np.ndarray:
    """(D,) standard deviations that the tuning file declares; infinite: none."""
    return np.concatenate(
        [np.full(s.size, np.inf if s.noise is None else s.noise_or_usual) for s in sensors]
    )


def finds_offset(sensors: Sequence[JointSensor]) -> np.ndarray:
    """(D,) bool: whether a reading's offset is to be found."""
    return np.concatenate([np.full(sensor.size, sensor.finds_offsets) for sensor in sensors])
