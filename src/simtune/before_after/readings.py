"""Measured joint readings, and simulated ones before and after tuning, replayed open loop."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simtune.fit import Lateness, OpenLoopReplay, Readings, replay_whole
from simtune.observation import ObservationModel, units_of
from simtune.run.files import plain
from simtune.simulation import AnySimulator
from simtune.trajectory import Trajectory


@dataclass(frozen=True)
class Replayed:
    """Measured and replayed readings of E episodes and D readings; NaN if not read.

    As tuned, also NaN before the first action takes effect: what acted before is not known.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    offsets: np.ndarray  # (D,) measured − simulated, as tuned
    step_s: float
    measured: np.ndarray  # (E, T + 1, D)
    before: np.ndarray
    after: np.ndarray

    def scores(self) -> dict[str, dict[str, Any]]:
        """{reading: unit, offset, and root mean square residuals}; JSON."""
        rms = [_rms(self.before - self.measured), _rms(self.after - self.measured)]
        rows = zip(self.labels, self.units, self.offsets, *rms, strict=True)
        keys = ("unit", "offset", "rms_before", "rms")
        return plain({label: dict(zip(keys, row, strict=True)) for label, *row in rows})

    def curves(self) -> dict[str, Any]:
        """Curves of the first episode; JSON."""
        known = np.isfinite(self.measured[0]).any(1)
        num = len(known) - int(known[::-1].argmax())
        films = {"measured": self.measured, "before": self.before, "after": self.after}
        curves = {
            label: {"unit": unit}
            | {name: np.round(values[0, :num, i], 6).tolist() for name, values in films.items()}
            for i, (label, unit) in enumerate(zip(self.labels, self.units, strict=True))
        }
        return {"step_s": self.step_s, "sensors": curves}


class Tuned(NamedTuple):
    """Results of tuning that a replay uses."""

    mean: np.ndarray  # (N,)
    offsets: Mapping[str, float]  # by a reading's label
    latency_steps: int = 0
    late_s: float = 0.0  # lateness of readings


def replay(
    simulator: AnySimulator,
    observation: ObservationModel,
    trajectories: list[Trajectory],
    start: np.ndarray,
    tuned: Tuned,
) -> Replayed:
    """Replay each episode from its first readings, with `start` (N,) parameters and as tuned."""
    loop = OpenLoopReplay.of(simulator, observation, start)
    joints, labels, space = loop.sensors, observation.reading_labels, simulator.space
    readings = Readings.of(trajectories, joints)
    before = replay_whole(loop, readings, space.to_unit(start), np.zeros(len(labels)))
    late_loop, late, unit, offsets = as_tuned(loop, readings, observation, tuned)
    replayed = replay_whole(late_loop, late, unit, offsets)
    after, steps = np.full_like(replayed, np.nan), min(tuned.latency_steps, replayed.shape[1])
    after[:, steps:] = replayed[:, : replayed.shape[1] - steps]
    return Replayed(
        labels, units_of(joints), offsets, simulator.step_s, readings.values, before, after
    )


def as_tuned(
    loop: OpenLoopReplay, readings: Readings, observation: ObservationModel, tuned: Tuned
) -> tuple[OpenLoopReplay, Readings, np.ndarray, np.ndarray]:
    """What `replay_whole` replays: a loop with lateness, readings beside actions, unit, offsets."""
    offsets = [tuned.offsets.get(label, 0.0) for label in observation.reading_labels]
    physics = loop.physics
    late = Lateness.unit(tuned.late_s / physics.simulator.step_s)
    unit = np.append(physics.parameters.to_unit(tuned.mean), late)
    delayed = readings.delayed(tuned.latency_steps)
    return loop.with_lateness(), delayed, unit, np.array(offsets)


def _rms(residuals: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean(np.square(residuals), (0, 1)))
