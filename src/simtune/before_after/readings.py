"""Measured joint readings, and simulated ones before and after tuning, replayed open loop."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simtune.fit import OpenLoopReplay, Readings, recorded_loop, replay_whole
from simtune.fit.lateness import late_unit
from simtune.fit.physics import is_lost
from simtune.fit.readings.readings import travel
from simtune.fit.readings.segments import Stretches
from simtune.fit.readings.whole_episodes import begin_whole, replay_from
from simtune.observation import ObservationModel, units_of
from simtune.run.files import plain
from simtune.simulation import AnySimulator
from simtune.trajectory import Trajectory

# Farther from where it begins than this in any unit, and than so many times what readings travel, a
# replay has diverged: MuJoCo leaves such a world where its physics stopped, at 1e13 or at no number
_DIVERGED_DISTANCE, _DIVERGED_TRAVELS = 1e4, 100.0


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

    As tuned, also NaN before the first action takes effect: what acted before is not known. NaN
    throughout an episode whose replay diverges.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    offsets: np.ndarray  # (D,) measured − simulated, as tuned
    step_s: float
    measured: np.ndarray  # (E, T + 1, D)
    before: np.ndarray
    after: np.ndarray
    tuned: TunedReplay | None = None  # which gave `after`
    diverged_before: tuple[int, ...] = ()  # episodes whose replay before tuning diverges
    diverged: tuple[int, ...] = ()  # and as tuned

    def scores(self) -> dict[str, dict[str, Any]]:
        """{reading: unit, offset, and root mean square residuals}; JSON.

        None if none can be compared. Episodes that diverge are left out, and counted under
        "diverged_before" and "diverged", if there are any.
        """
        rms = [_rms(self.before - self.measured), _rms(self.after - self.measured)]
        rows = zip(self.labels, self.units, self.offsets, *rms, strict=True)
        keys = ("unit", "offset", "rms_before", "rms")
        counts = {"diverged_before": len(self.diverged_before), "diverged": len(self.diverged)}
        lost = {key: num for key, num in counts.items() if num}
        return plain({label: dict(zip(keys, row, strict=True)) | lost for label, *row in rows})

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
    joints, labels = observation.sensors, observation.reading_labels
    readings, space = Readings.of(trajectories, joints), simulator.space
    loop = recorded_loop(simulator, observation, start, readings)
    before = replay_whole(loop, readings, space.to_unit(start), np.zeros(len(labels)))
    lost_before = _diverging(before, readings.values)
    offsets = np.array([tuned.offsets.get(label, 0.0) for label in labels])
    unit = np.append(space.to_unit(tuned.mean), late_unit(tuned.late_s / simulator.step_s))
    loop, late = loop.with_lateness(), readings.delayed(tuned.latency_steps)
    begun = TunedReplay(loop, *begin_whole(loop, late, unit, offsets), unit)
    played = replay_from(loop, begun.whole, begun.states, unit, np.zeros(len(labels)))
    lost = _diverging(played, late.values)
    before[lost_before], played[lost] = np.nan, np.nan
    after, steps = np.full_like(played, np.nan), min(tuned.latency_steps, played.shape[1])
    after[:, steps:] = played[:, : played.shape[1] - steps] + offsets
    return Replayed(
        labels,
        units_of(joints),
        offsets,
        simulator.step_s,
        readings.values,
        before,
        after,
        begun,
        tuple(np.flatnonzero(lost_before).tolist()),
        tuple(np.flatnonzero(lost).tolist()),
    )


def _diverging(predicted: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(E,) bool of (E, T + 1, D) predictions, without offsets, beside readings.

    Whether a world diverges by its last reading.
    """
    is_read = np.asarray(np.isfinite(values).any(-1))
    counts = np.logical_or.accumulate(is_read[:, ::-1], 1)[:, ::-1]
    played = np.where(counts[..., None], predicted, predicted[:, :1])
    far = np.maximum(_DIVERGED_DISTANCE, _DIVERGED_TRAVELS * travel(values).max(0, initial=0))
    return is_lost(played) | (np.abs(played - played[:, :1]) > far).any((1, 2))


def _rms(residuals: np.ndarray) -> np.ndarray:
    """(D,) of (E, T + 1, D); NaN where none is known."""
    known = np.isfinite(residuals)
    total = np.square(np.where(known, residuals, 0.0)).sum((0, 1))
    num = known.sum((0, 1))
    return np.where(num, np.sqrt(total / np.maximum(num, 1)), np.nan)
