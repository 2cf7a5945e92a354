"""Pictures of a simulator's worlds, for comparison with a film."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simtune.cameras.views import apart
from simtune.checking.film.camera_film import MOST_FILMED_STEPS
from simtune.checking.film.features import SIZE, Features, describe, squeezed
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
    played = actions[np.arange(_WORLDS) % len(actions), :MOST_FILMED_STEPS].astype(float)
    rollouts = simulator.roll_out(worlds, played, rng)
    if len(rollouts) < _FEWEST_WORLDS:
        return []
    states = rollouts.states[:, np.linspace(0, played.shape[1], _PICTURES).astype(int)]
    parameters = np.repeat(rollouts.parameters, _PICTURES, 0)
    frames = simulator.render(states.reshape(len(parameters), -1), parameters)
    views = squares(frames, simulator.widths, states.shape[:2])
    return [Library(states, view, describe(view)) for view in views]


def squares(pictures: np.ndarray, widths: Sequence[int], shape: Sequence[int]) -> list[np.ndarray]:
    """Each view's (*shape, SIZE, SIZE, 3), of (n, H, W₁ + W₂ + …, 3) pictures of all."""
    return [squeezed(view).reshape(*shape, SIZE, SIZE, 3) for view in apart(pictures, widths)]
