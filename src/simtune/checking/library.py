"""Pictures of a simulator's worlds, for a film to be compared with."""

from dataclasses import dataclass

import numpy as np

from simtune.checking.features import Features, describe
from simtune.randomization import Distribution
from simtune.simulation import Simulator

MOST_STEPS = 200  # of an episode that are looked at
_WORLDS, _PICTURES = 32, 24  # of each world
_FEWEST_WORLDS = 8  # that do not diverge


@dataclass(frozen=True)
class Library:
    """W worlds of the simulator, each filmed in K of its states."""

    states: np.ndarray  # (W, K, S)
    frames: np.ndarray  # (W, K, SIZE, SIZE, 3) uint8
    features: Features  # of W · K pictures

    @property
    def worlds(self) -> np.ndarray:
        """(W · K,) the world of each picture."""
        return np.repeat(np.arange(len(self.frames)), self.frames.shape[1])


def make_library(simulator: Simulator, actions: np.ndarray, seed: int) -> Library | None:
    """Worlds that play (E, T, A) actions, an episode each; None where nearly all diverge.

    The simulator's pictures are SIZE pixels a side.
    """
    rng, space = np.random.default_rng((seed, 2)), simulator.space
    worlds = Distribution.first(space, space.nominal).sample(_WORLDS, rng)
    played = actions[np.arange(_WORLDS) % len(actions), :MOST_STEPS].astype(float)
    rollouts = simulator.roll_out(worlds, played, rng)
    if len(rollouts) < _FEWEST_WORLDS:
        return None
    states = rollouts.states[:, np.linspace(0, played.shape[1], _PICTURES).astype(int)]
    parameters = np.repeat(rollouts.parameters, _PICTURES, 0)
    frames = simulator.render(states.reshape(len(parameters), -1), parameters)
    frames = frames.reshape(*states.shape[:2], *frames.shape[1:])
    return Library(states, frames, describe(frames))
