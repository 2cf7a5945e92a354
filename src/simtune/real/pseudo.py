"""A simulated world that plays the real one."""

import numpy as np

from simtune.simulation import Simulator, random_actions
from simtune.trajectory import Trajectory


class PseudoReal:
    """A world of fixed parameters that only `collect` can be asked of.

    The parameters are kept out of reach: whoever tunes gets frames and actions, as from a
    robot. Scoring takes the truth from whoever made this world, not from here.
    """

    def __init__(
        self,
        simulator: Simulator,
        parameters: np.ndarray,
        *,
        episode_steps: int,
        seed: int,
    ):
        rng = np.random.default_rng(seed)
        self.step_s = simulator.step_s
        self.num_actions = simulator.num_actions

        def film(num_episodes: int) -> list[Trajectory]:
            actions = random_actions(num_episodes, episode_steps, simulator.model, rng)
            rollouts = simulator.roll_out(np.tile(parameters, (num_episodes, 1)), actions, rng)
            if not len(rollouts):
                raise RuntimeError("every episode of the pseudo-real world diverged")
            return [
                Trajectory(frames, played.astype(np.float32), simulator.step_s)
                for frames, played in zip(simulator.film(rollouts), rollouts.actions, strict=True)
            ]

        self._film = film

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """Film episodes of random actions, by default 5. Worlds that diverge yield fewer."""
        return self._film(num_episodes or 5)
