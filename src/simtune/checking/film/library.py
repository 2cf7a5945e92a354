"""Pictures of a simulator's worlds, for comparison with a film."""

from dataclasses import dataclass

import numpy as np

from simtune.cameras.pictures import resize
from simtune.cameras.views import apart
from simtune.checking.film.camera_film import MOST_STEPS
from simtune.checking.film.features import SIZE, Features, describe
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.simulation import Simulator

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


def make_libraries(simulator: Simulator, actions: np.ndarray, seed: int) -> list[Library]:
    """Worlds that play (E, T, A) actions, an episode each, as each camera sees them.

    Empty if nearly all worlds diverge.
    """
    rng, space = stream(seed, Purpose.LIBRARY), simulator.space
    worlds = Distribution.first(space, space.nominal).sample(_WORLDS, rng)
    played = actions[np.arange(_WORLDS) % len(actions), :MOST_STEPS].astype(float)
    rollouts = simulator.roll_out(worlds, played, rng)
    if len(rollouts) < _FEWEST_WORLDS:
        return []
    states = rollouts.states[:, np.linspace(0, played.shape[1], _PICTURES).astype(int)]
    parameters = np.repeat(rollouts.parameters, _PICTURES, 0)
    frames = simulator.render(states.reshape(len(parameters), -1), parameters)
    views = [brought_to_size(view) for view in apart(frames, simulator.widths)]
    views = [view.reshape(*states.shape[:2], *view.shape[1:]) for view in views]
    return [Library(states, view, describe(view)) for view in views]


def brought_to_size(frames: np.ndarray) -> np.ndarray:
    """(n, H, W, 3) frames as squares of SIZE pixels, squeezed."""
    return np.stack([resize(frame, (SIZE, SIZE)) for frame in frames])
