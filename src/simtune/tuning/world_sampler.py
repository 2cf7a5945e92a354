"""Simulated worlds to learn from: drawn from Ξ, with the real actions, partly drawn as pictures."""

from collections.abc import Iterator

import numpy as np

from simtune.budget import Budget
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.search_param_model.simulated import (
    FilmedWorlds,
    PlayedWorlds,
    SimulatedWorlds,
    play_worlds,
)
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.trajectory import Trajectory
from simtune.tuning.search import SearchContext

_BATCH_WORLDS = 64  # between looks at the clock; the fewest to learn from


class WorldSampler:
    """Draws the number of worlds asked for, or fewer if the budget runs out."""

    def __init__(self, context: SearchContext):
        self._context, self.rng = context, stream(context.seed, Purpose.SEARCHED_WORLDS)

    def play(
        self,
        real: list[Trajectory],
        searched: Distribution,
        num_worlds: int,
        num_episodes: int,
        budget: Budget,
    ) -> SimulatedWorlds:
        """Worlds of `num_episodes` each, without pictures."""
        played = budget.each(self._play(real, searched, num_worlds, num_episodes))
        return SimulatedWorlds.joined([p.unfilmed() for p in played])

    def film(
        self,
        real: list[Trajectory],
        searched: Distribution,
        num_worlds: int,
        num_frames: int,
        budget: Budget,
    ) -> FilmedWorlds:
        """Worlds of an episode each, of which `num_frames` successive frames are filmed."""
        num_frames, played = self._affordable(num_frames), self._play(real, searched, num_worlds, 1)
        return FilmedWorlds.joined([p.filmed(num_frames, self.rng) for p in budget.each(played)])

    def play_and_draw(
        self,
        real: list[Trajectory],
        searched: Distribution,
        num_worlds: int,
        num_episodes: int,
        num_pictures: int,
        budget: Budget,
    ) -> tuple[SimulatedWorlds, TrainingPictures]:
        """The same as `play`, and `num_pictures` for each world."""
        worlds, pictures = [], []
        for played in budget.each(self._play(real, searched, num_worlds, num_episodes)):
            num = len(played.whole) * self._affordable(num_pictures)
            worlds.append(played.unfilmed())
            pictures.append(TrainingPictures.draw(played, searched, num, self.rng))
        return SimulatedWorlds.joined(worlds), TrainingPictures.joined(pictures)

    def _affordable(self, num_pictures: int) -> int:
        """Supersampled pictures are expensive."""
        return max(2, num_pictures // self._context.simulator.supersampling)

    def _play(
        self, real: list[Trajectory], searched: Distribution, num_worlds: int, num_episodes: int
    ) -> Iterator[PlayedWorlds]:
        """Worlds that replay the actions of `num_episodes` real episodes, some at a time."""
        context, rng = self._context, self.rng
        steps = min(len(t) for t in real)
        actions, left = np.stack([t.actions[:steps] for t in real]), num_worlds
        while left:
            # A few alone may all diverge
            num = _BATCH_WORLDS if left >= 2 * _BATCH_WORLDS else left
            left -= num
            which = np.stack([rng.permutation(len(real))[:num_episodes] for _ in range(num)])
            yield play_worlds(
                context.simulator,
                context.keypoints,
                searched.sample(num, rng),
                actions[which],
                rng,
                context.observation,
            )
