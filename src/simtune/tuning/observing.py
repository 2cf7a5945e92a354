"""What a fit sees of episodes: the detections and readings in them, each with its noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.fit import PICTURES, Lateness, Observed
from simtune.observation import AllEvidence, JointReadings
from simtune.search_param_model.simulated import FilmedWorlds
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory
from simtune.tuning.learning import HeldOut
from simtune.tuning.search import SearchContext
from simtune.vision.detections import Detections
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.keypoint_tracks import KeypointTracks

# Factor on the readings' noise in windows, if they cannot be replayed alone. They are far sharper
# than pictures, and contacts make the motion rough: at full weight no step of a fit lowers the
# cost, and hardly any particle survives. In five worlds of a walker (readings of .001 rad), fits
# from below and above end .008 apart in a mass's unit coordinate at ten times the noise, .005 at
# thirty and at a hundred.
_NOISE_INFLATION = 30.0


@dataclass(frozen=True)
class Observing:
    """How real and known worlds alike become what a fit sees."""

    context: SearchContext
    noise: DetectorNoise
    learnt_from: AllEvidence  # by the state estimator: on its scale readings are given to it
    inflates_noise: bool = False  # of readings, see `_NOISE_INFLATION`

    def observed(
        self, trajectories: Sequence[Trajectory], detections: Sequence[Detections]
    ) -> Observed:
        """Episodes cut to equal length, with the detections in their frames."""
        steps = min(len(t) for t in trajectories)
        cut = [found.first(steps + 1) for found in detections]
        tracks = KeypointTracks.of_detections(cut, self._simulator.shape, self.noise)
        first = [t.first(steps) for t in trajectories]
        names = first[0].readings
        readings = {name: np.stack([t.readings[name] for t in first]) for name in names}
        evidence = self.context.observation.evidence(tracks, readings)
        evidence = _scaled_as(evidence, self.learnt_from)
        if self.inflates_noise:
            evidence = _with_inflated_noise(evidence)
        actions = np.stack([t.actions for t in first]).astype(float)
        frames = [t.frames for t in first]  # views, not copies: there may be many
        return Observed(evidence, actions, frames, self._lateness(evidence))

    def _lateness(self, evidence: AllEvidence) -> Lateness | None:
        """What may be late by a part of a step."""
        substeps = self._simulator.num_substeps
        if self.max_latency_steps:
            return Lateness.of_evidence(evidence, substeps)
        # A declared delay is of actions: beside readings, pictures tell how late the camera is
        observation, is_declared = self.context.observation, self._simulator.space.is_delay.any()
        if is_declared and observation.max_latency_steps and observation.sensors:
            return Lateness.of_evidence(evidence, substeps, [PICTURES])
        return None

    @property
    def max_latency_steps(self) -> int:
        """Most control steps that actions may come late, unless that is known."""
        return self.context.observation.unknown_latency_steps(self._simulator)

    @property
    def _simulator(self) -> Simulator:
        return simulator_of(self.context)


def simulator_of(context: SearchContext) -> Simulator:
    """Of a context that can fit."""
    assert isinstance(context.simulator, Simulator), "see SearchContext.can_fit"
    return context.simulator


def as_observed(
    context: SearchContext, held_out: HeldOut, real: Sequence[Trajectory] = ()
) -> Observed:
    """Held-out worlds as a fit sees a real one, with readings missing where `real` ones are."""
    worlds, shape = held_out.worlds, context.simulator.shape
    tracks = KeypointTracks.of_detections(held_out.episodes, shape, held_out.noise())
    readings = _with_gaps(worlds, real) if real else worlds.readings
    evidence = context.observation.evidence(tracks, readings)
    return Observed(evidence, worlds.filmed_actions().astype(float))


def _with_gaps(worlds: FilmedWorlds, real: Sequence[Trajectory]) -> dict[str, np.ndarray]:
    """{sensor: (W, F, D)} of worlds, each without the readings that a real episode lacks."""
    steps = min(len(t) for t in real)
    at = worlds.filmed_from[:, None] + np.arange(worlds.frames.shape[1])  # (W, F), within `steps`
    episode = np.arange(len(at))[:, None] % len(real)
    readings = dict(worlds.readings)
    for name, values in readings.items():
        recorded = np.stack([t.readings[name][: steps + 1] for t in real])
        readings[name] = np.where(np.isnan(recorded[episode, at]), np.nan, values)
    return readings


def _scaled_as(evidence: AllEvidence, other: AllEvidence) -> AllEvidence:
    """Evidence whose joint readings are features on the scale of another's."""
    like = {part.name: part for part in other.parts if isinstance(part, JointReadings)}
    return evidence.with_each(JointReadings, lambda part: part.scaled_as(like[part.name]))


def _with_inflated_noise(evidence: AllEvidence) -> AllEvidence:
    """Evidence whose joint readings count as if they were noisier."""
    return evidence.with_each(
        JointReadings, lambda part: replace(part, noise=_NOISE_INFLATION * part.noise)
    )
