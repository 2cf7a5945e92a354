"""What the posterior SPM learns from: simulated worlds, of which only a part is drawn."""

from dataclasses import dataclass

import numpy as np

from simtune.randomization import Distribution
from simtune.search_param_model.landmarks import (
    Landmarks,
    candidate_landmarks,
    choose_landmarks,
)
from simtune.simulation import Simulator, random_actions

PILOT_STEPS = 3200  # simulated to choose landmarks by
_PILOTS = 32


@dataclass(frozen=True)
class SimulatedWorlds:
    """What one round of simulation gives: W worlds of E episodes of T steps each."""

    parameters: np.ndarray  # (W, N)
    actions: np.ndarray  # (W, E, T, A)
    landmarks: np.ndarray  # (W, E, T + 1, L, 2) pixels, true
    frames: np.ndarray  # (W, F, H, H, 3) uint8: F successive frames of each world's...
    filmed_from: np.ndarray  # (W,) ...first episode, from this step on

    def filmed_landmarks(self) -> np.ndarray:
        """(W, F, L, 2) the true landmarks in `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1])
        return self.landmarks[np.arange(len(at))[:, None], 0, at]

    def split(self, num: int) -> tuple["SimulatedWorlds", "SimulatedWorlds"]:
        """The first `num` worlds, and the others."""
        fields = vars(self)
        return (
            SimulatedWorlds(**{k: v[:num] for k, v in fields.items()}),
            SimulatedWorlds(**{k: v[num:] for k, v in fields.items()}),
        )


def simulate(
    simulator: Simulator,
    landmarks: Landmarks,
    parameters: np.ndarray,
    actions: np.ndarray,
    num_filmed: int,
    rng: np.random.Generator,
) -> SimulatedWorlds:
    """Play (W, E, T, A) actions in W worlds of (W, N) parameters, and film a stretch of each.

    Worlds of which an episode diverged are left out. Raises RuntimeError if hardly any is left.
    """
    num_episodes, steps = actions.shape[1:3]
    rollouts = simulator.roll_out(
        np.repeat(parameters, num_episodes, axis=0),
        actions.reshape(-1, *actions.shape[2:]).astype(float),
        rng,
        landmarks.record,
    )
    assert rollouts.recorded is not None, "asked for above"
    whole = whole_sets(rollouts.parameters, num_episodes)
    if len(whole) < 4:  # some to learn from, some to measure errors on
        raise RuntimeError("nearly every world diverged; check the timestep and the bounds")
    num_worlds, num_filmed = len(whole), min(num_filmed, steps + 1)
    start = rng.integers(0, steps + 2 - num_filmed, num_worlds)
    states = rollouts.states[whole[:, :1], start[:, None] + np.arange(num_filmed)]
    kept = rollouts.parameters[whole[:, 0]]
    frames = simulator.render(
        states.reshape(num_worlds * num_filmed, -1), np.repeat(kept, num_filmed, axis=0)
    )
    return SimulatedWorlds(
        kept,
        rollouts.actions[whole],
        rollouts.recorded[whole].reshape(num_worlds, num_episodes, steps + 1, -1, 2),
        frames.reshape(num_worlds, num_filmed, *frames.shape[1:]),
        start,
    )


def whole_sets(parameters: np.ndarray, episodes: int) -> np.ndarray:
    """(W, E) indices of the worlds, by their parameters, all of whose E episodes are there."""
    changes = np.flatnonzero(np.any(np.diff(parameters, axis=0) != 0, axis=1)) + 1
    sets = np.split(np.arange(len(parameters)), changes)
    return np.array([s for s in sets if len(s) == episodes], int).reshape(-1, episodes)


def find_landmarks(
    simulator: Simulator, camera: str, distribution: Distribution, seed: int
) -> Landmarks:
    """Few landmarks from which all others follow, judged by a few random episodes."""
    rng = np.random.default_rng(seed)
    every = candidate_landmarks(simulator.model, camera, simulator.image_size)
    if not len(every):
        return every
    actions = random_actions(_PILOTS, PILOT_STEPS // _PILOTS, simulator.model, rng)
    rollouts = simulator.roll_out(distribution.sample(_PILOTS, rng), actions, rng, every.record)
    assert rollouts.recorded is not None, "asked for above"
    return every.select(choose_landmarks(rollouts.recorded.reshape(-1, len(every), 2)))
