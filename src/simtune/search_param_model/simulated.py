"""Simulated worlds for the posterior SPM, only partly rendered."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from simtune.observation import ObservationModel
from simtune.simulation import AnySimulator, Points
from simtune.trajectory import delayed
from simtune.vision.keypoints import Keypoints


@dataclass(frozen=True)
class SimulatedWorlds:
    """One round of simulation: W worlds of E episodes of T steps each."""

    parameters: np.ndarray  # (W, N)
    actions: np.ndarray  # (W, E, T, A)
    keypoints: np.ndarray  # (W, E, T + 1, L, 2) pixels, true
    frames: np.ndarray  # (W, F, H, W, 3) uint8: successive ones of each world's first episode
    filmed_from: np.ndarray  # (W,) step of the first frame
    states: np.ndarray  # (W, F, S) full states of `frames`
    # {sensor: (W, F, D)} measured with `frames`
    readings: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def joined(cls, parts: Sequence["SimulatedWorlds"]) -> "SimulatedWorlds":
        """The worlds of several parts."""
        fields = {name: [vars(part)[name] for part in parts] for name in vars(parts[0])}
        readings = fields.pop("readings")
        arrays = {name: np.concatenate(values) for name, values in fields.items()}
        by_sensor = {name: np.concatenate([its[name] for its in readings]) for name in readings[0]}
        return cls(**arrays, readings=by_sensor)

    def filmed_keypoints(self) -> np.ndarray:
        """(W, F, L, 2) true keypoints in `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1])
        return self.keypoints[np.arange(len(at))[:, None], 0, at]

    def filmed_actions(self) -> np.ndarray:
        """(W, F − 1, A) between `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1] - 1)
        return self.actions[np.arange(len(at))[:, None], 0, at]

    def without_frames(self) -> "SimulatedWorlds":
        """The same without frames, which take most memory."""
        return replace(self, frames=self.frames[:0].copy())


def simulate(
    simulator: AnySimulator,
    keypoints: Keypoints | Points,
    parameters: np.ndarray,
    actions: np.ndarray,
    num_filmed: int,
    rng: np.random.Generator,
    observation: ObservationModel,
) -> SimulatedWorlds:
    """Play (W, E, T, A) actions in W worlds of (W, N) parameters, and film a stretch of each.

    If actions may be late, they are, by a step, in half of the worlds, unless a parameter is a
    delay. Worlds with a diverged episode are left out. Raises RuntimeError if hardly any is left.
    """
    num_episodes, steps = actions.shape[1:3]
    played = actions.astype(float)
    if observation.max_latency_steps and not simulator.space.is_delay.any():
        late = rng.random(len(actions)) < 0.5
        played[late] = delayed(played[late], 1)
    rollouts = simulator.roll_out(
        np.repeat(parameters, num_episodes, axis=0),
        played.reshape(len(played) * num_episodes, *actions.shape[2:]),  # there may be no actions
        rng,
        observation.observe_beside(keypoints.observe),
    )
    whole = whole_sets(rollouts.index, num_episodes)
    if len(whole) < 4:  # some for training, some to measure errors
        raise RuntimeError("nearly every world diverged; check the timestep and the bounds")
    num_worlds, num_filmed = len(whole), min(num_filmed, steps + 1)
    start = rng.integers(0, steps + 2 - num_filmed, num_worlds)
    at = start[:, None] + np.arange(num_filmed)
    states = rollouts.states[whole[:, :1], at]
    kept = rollouts.parameters[whole[:, 0]]
    filmed = replace(rollouts, parameters=kept, states=states)
    frames = simulator.film(filmed, observation.stray_light(num_worlds, rng))
    observation.add_noise(simulator, frames, rng)
    points, measured = np.split(rollouts.observed[whole], [2 * len(keypoints)], axis=-1)
    with_frames = measured[np.arange(num_worlds)[:, None], 0, at]
    return SimulatedWorlds(
        kept,
        actions[rollouts.index[whole[:, 0]] // num_episodes],
        points.astype(np.float32).reshape(num_worlds, num_episodes, steps + 1, -1, 2),
        frames,
        start,
        states,
        observation.readings(with_frames, rng),
    )


def whole_sets(index: np.ndarray, episodes: int) -> np.ndarray:
    """(W, E) positions in `index` (n,) of the complete sets of E successive episodes."""
    _, start, count = np.unique(index // episodes, return_index=True, return_counts=True)
    return start[count == episodes, None] + np.arange(episodes)
