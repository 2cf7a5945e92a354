"""Simulated worlds to learn from: drawn from Ξ, with the real actions, partly filmed."""

import numpy as np

from simtune.budget import Budget
from simtune.randomization import Distribution
from simtune.search_param_model.simulated import SimulatedWorlds, simulate
from simtune.trajectory import Trajectory
from simtune.tuning.search import SearchContext

_AT_A_TIME = 64  # worlds between looks at the clock; the fewest to learn from


class WorldSampler:
    """Draws as many worlds as there is time for."""

    def __init__(self, context: SearchContext):
        self._context, self.rng = context, np.random.default_rng(context.seed)

    def sample(
        self,
        real: list[Trajectory],
        distribution: Distribution,
        num_worlds: int,
        num_episodes: int,
        num_filmed: int,
        budget: Budget,
    ) -> SimulatedWorlds:
        """Worlds that replay the actions of `num_episodes` real episodes; a stretch is filmed.

        `num_worlds` worlds, or fewer if `budget` would be over before.
        """
        context, rng = self._context, self.rng
        # Supersampled pictures are expensive.
        num_filmed = max(2, num_filmed // context.simulator.supersampling)
        steps = min(len(t) for t in real)
        actions, parts, left = np.stack([t.actions[:steps] for t in real]), [], num_worlds
        while left:
            num = _AT_A_TIME if left >= 2 * _AT_A_TIME else left  # a few alone may all diverge
            left -= num
            which = np.stack([rng.permutation(len(real))[:num_episodes] for _ in range(num)])
            worlds = distribution.sample(num, rng)
            parts.append(
                simulate(
                    context.simulator,
                    context.keypoints,
                    worlds,
                    actions[which],
                    num_filmed,
                    rng,
                    context.observation,
                )
            )
            if not budget.allows_another(len(parts)):
                break
        return SimulatedWorlds.joined(parts)
