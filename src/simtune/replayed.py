"""Joint readings beside the simulator's, before and after tuning, replayed open loop."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.fit import OpenLoop, Physics, Readings
from simtune.observation import JointSensor
from simtune.run.files import plain
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.search import Estimate, SearchContext


@dataclass(frozen=True)
class Replayed:
    """Of E episodes and D readings; NaN where nothing was read."""

    labels: tuple[str, ...]
    units: tuple[str, ...]
    offsets: np.ndarray  # (D,) measured − simulated, as tuned
    step_s: float
    measured: np.ndarray  # (E, T + 1, D)
    before: np.ndarray
    after: np.ndarray

    def scores(self) -> dict[str, dict[str, Any]]:
        """{reading: its unit and offset, and the root mean square of what is left}; JSON."""
        rms = [_rms(self.before - self.measured), _rms(self.after - self.measured)]
        rows = zip(self.labels, self.units, self.offsets, *rms, strict=True)
        keys = ("unit", "offset", "rms_before", "rms")
        return plain({label: dict(zip(keys, row, strict=True)) for label, *row in rows})

    def curves(self) -> dict[str, Any]:
        """Of the first episode; JSON."""
        known = np.isfinite(self.measured[0]).any(1)
        num = len(known) - int(known[::-1].argmax())
        films = {"measured": self.measured, "before": self.before, "after": self.after}
        curves = {
            label: {"unit": unit}
            | {name: np.round(its[0, :num, i], 6).tolist() for name, its in films.items()}
            for i, (label, unit) in enumerate(zip(self.labels, self.units, strict=True))
        }
        return {"step_s": self.step_s, "sensors": curves}


def replay(context: SearchContext, trajectories: list[Trajectory], estimate: Estimate) -> Replayed:
    """Each episode from its first readings, in the simulator as it was and as it was tuned."""
    simulator, sensors = context.simulator, context.observation.sensors
    assert isinstance(simulator, Simulator), "sensors measure a model's joints"
    joints = tuple(sensor for sensor in sensors if isinstance(sensor, JointSensor))
    still = np.zeros((1, 1, simulator.num_actions))
    rng = np.random.default_rng(context.seed)
    start = simulator.roll_out(context.start[None], still, rng, keep_diverged=True)
    physics = Physics(simulator, context.observation.observe_beside(), start.states[0, 0])
    loop = OpenLoop(physics, joints, np.arange(len(simulator.space)))
    readings = Readings.of(trajectories, joints)
    labels = context.observation.reading_labels
    offsets = np.array([estimate.offsets.get(label, 0.0) for label in labels])
    space = simulator.space
    before = loop.replay(readings, space.to_unit(context.start), np.zeros(len(labels)))
    late = readings.delayed(estimate.latency_steps)
    after = loop.replay(late, space.to_unit(estimate.mean), offsets)
    units = tuple(sensor.unit for sensor in joints for _ in sensor.joints)
    return Replayed(labels, units, offsets, simulator.step_s, readings.values, before, after)


def _rms(residuals: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean(np.square(residuals), (0, 1)))
