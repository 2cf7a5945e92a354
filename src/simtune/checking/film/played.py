"""Worlds of a simulator that play recorded actions, drawn at a film's moments."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.film.camera_film import MOST_FILMED_STEPS
from simtune.checking.film.library import squares
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.trajectory import moments

_WORLDS, _FEWEST_WORLDS = 8, 4  # drawn, and that do not diverge


class Played:
    """Each episode's actions, played in each of some worlds."""

    def __init__(self, simulator: Simulator, episodes: Sequence[np.ndarray], seed: int):
        """`episodes`: (T, A) actions of each; T may differ."""
        self._simulator, num = simulator, len(episodes)
        self._lengths = np.array([min(len(actions), MOST_FILMED_STEPS) for actions in episodes])
        longest = int(self._lengths.max())
        held = [np.minimum(np.arange(longest), length - 1) for length in self._lengths]
        actions = [taken[at].astype(float) for taken, at in zip(episodes, held, strict=True)]
        rng, space = stream(seed, Purpose.PLAYED_ACTIONS), simulator.space
        worlds = Distribution.first(space, space.nominal).sample(_WORLDS, rng)
        rollouts = simulator.roll_out(worlds.repeat(num, 0), np.tile(actions, (_WORLDS, 1, 1)), rng)
        alive = np.bincount(rollouts.index // num, minlength=_WORLDS) == num  # in all episodes
        kept = rollouts.only(alive[rollouts.index // num])
        self._states = kept.states.reshape(-1, num, *kept.states.shape[1:])  # (W, E, T + 1, S)
        self._parameters = kept.parameters.reshape(-1, num, kept.parameters.shape[1])

    @property
    def are_enough(self) -> bool:
        """Whether most worlds do not diverge."""
        return len(self._states) >= _FEWEST_WORLDS

    def draw(self, num_pictures: int, late_steps: int = 0) -> list[np.ndarray]:
        """Each view's, (W, E, K, SIZE, SIZE, 3): moments as `Dataset.skim` keeps them.

        `late_steps`: by which pictures show an earlier moment.
        """
        last = self._lengths[:, None]
        steps = moments(last, num_pictures) - late_steps
        steps = steps.clip(0, last)
        states = self._states[:, np.arange(len(steps))[:, None], steps]
        parameters = self._parameters.repeat(num_pictures, 1)
        drawn = self._simulator.render(
            states.reshape(-1, states.shape[-1]), parameters.reshape(-1, parameters.shape[-1])
        )
        return squares(drawn, self._simulator.widths, states.shape[:3])
