"""Measured joint readings, and simulated ones before and after tuning, replayed open loop."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simtune.fit import Lateness, OpenLoopReplay, Readings, recorded_loop, replay_whole
from simtune.fit.readings.stretches import Stretches
from simtune.fit.readings.whole_episodes import begin_whole, replay_from
from simtune.observation import ObservationModel, joints_of, units_of
from simtune.run.files import plain
from simtune.simulation import AnySimulator
from simtune.trajectory import Trajectory


class TunedReplay(NamedTuple):
    """Whole episodes in a tuned simulator, from where they begin."""

    loop: OpenLoopReplay
    whole: Stretches
    states: np.ndarray  # (E, nq + nv) in the beginning
    unit: np.ndarray  # (N + 1,) parameters and lateness in unit coordinates

    def of(self, chosen: np.ndarray) -> "TunedReplay":
        """Of the episodes that (E,) bool chooses."""
        return self._replace(whole=self.whole.of(chosen), states=self.states[chosen])


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
    tuned: TunedReplay | None = None  # which gave `after`

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
    joints, labels = joints_of(observation.sensors), observation.reading_labels
    readings, space = Readings.of(trajectories, joints), simulator.space
    loop = recorded_loop(simulator, observation, start, readings)
    before = replay_whole(loop, readings, space.to_unit(start), np.zeros(len(labels)))
    offsets = np.array([tuned.offsets.get(label, 0.0) for label in labels])
    unit = np.append(space.to_unit(tuned.mean), Lateness.unit(tuned.late_s / simulator.step_s))
    loop, late = loop.with_lateness(), readings.delayed(tuned.latency_steps)
    begun = TunedReplay(loop, *begin_whole(loop, late, unit, offsets), unit)
    played = replay_from(loop, begun.whole, begun.states, unit, offsets)
    after, steps = np.full_like(played, np.nan), min(tuned.latency_steps, played.shape[1])
    after[:, steps:] = played[:, : played.shape[1] - steps]
    return Replayed(
        labels, units_of(joints), offsets, simulator.step_s, readings.values, before, after, begun
    )


def _rms(residuals: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean(np.square(residuals), (0, 1)))
