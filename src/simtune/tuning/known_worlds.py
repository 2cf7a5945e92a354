"""Known worlds for refits: filmed and read as the real one was."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.fit import READINGS, FitResult, Lateness, Observed, states_in_late_pictures
from simtune.fit.lateness import late_unit
from simtune.observation import JointReadings
from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.simulation import Rollouts
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.observing import Observing, simulator_of


@dataclass(frozen=True)
class KnownWorlds:
    """They play the actions of E real episodes, from where a fit says that these began.

    What is late or missing in the real world is so in these as well.
    """

    observing: Observing
    model: PosteriorSearchParamModel
    like: Observed  # the E real episodes
    fit: FitResult  # of these and others
    rng: np.random.Generator

    def synthesize(self, parameters: np.ndarray, latency_steps: int) -> Observed | None:
        """Episodes of a world of (N,) parameters, with late actions; None if it diverges."""
        simulator, actions = simulator_of(self.observing.context), self.like.actions
        rollouts = self._play(parameters, delayed(actions, latency_steps))
        if len(rollouts) < len(actions):
            return None
        late_steps = self.fit.pictures_late_s[0] / simulator.step_s
        shown = states_in_late_pictures(simulator, rollouts.states, late_steps)
        rollouts = replace(rollouts, states=shown)
        recorded = self.observing.context.observation.record(simulator, rollouts, self.rng)
        detections = [self.model.detect(trajectory.frames) for trajectory in recorded]
        recorded = without_missing(recorded, missing_readings(self.like))
        return replace(self.observing.observed(recorded, detections), actions=actions)

    def _play(self, parameters: np.ndarray, actions: np.ndarray) -> Rollouts:
        """With what sensors read, as late as the fit found; fewer than E where some diverge."""
        simulator = simulator_of(self.observing.context)
        see = self.observing.context.observation.observe_beside()
        worlds = np.repeat(parameters[None], len(actions), 0)
        # What an action moves depends on where objects stand. With the box elsewhere, actions that
        # had moved ALOHA's real box moved nothing.
        starts = self.fit.starts[: len(actions)]
        late_s, _ = self.fit.late_s.get(READINGS, (0.0, 0.0))
        if not late_s:
            return simulator.roll_out(worlds, actions, self.rng, see, starts)
        num_readings = sum(len(part.scale) for part in _readings(self.like))
        lateness = Lateness.of_readings(num_readings, simulator.num_substeps)
        played = simulator.play(
            worlds,
            lambda t, _: actions[:, t],
            actions.shape[1],
            self.rng,
            starts=starts,
            observe=see,
            observations_per_step=lateness.predictions_per_step,
        ).finished()
        late = np.full((len(played), 1), late_unit(late_s / simulator.step_s))
        return replace(played, observed=lateness.seen(played.observed, late))


def missing_readings(observed: Observed) -> dict[str, np.ndarray]:
    """{sensor: (E, T + 1, D) bool} of what it did not read."""
    return {part.name: np.isnan(part.values) for part in _readings(observed)}


def without_missing(
    recorded: Sequence[Trajectory], missing: Mapping[str, np.ndarray]
) -> list[Trajectory]:
    """E episodes with NaN where readings are `missing`."""
    lacking = []
    for number, trajectory in enumerate(recorded):
        readings = dict(trajectory.readings)
        for name, where in missing.items():
            readings[name] = np.where(where[number], np.nan, readings[name])
        lacking.append(replace(trajectory, readings=readings))
    return lacking


def _readings(observed: Observed) -> list[JointReadings]:
    return [part for part in observed.evidence.parts if isinstance(part, JointReadings)]
