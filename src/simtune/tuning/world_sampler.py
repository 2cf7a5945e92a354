"""Simulated worlds to learn from: drawn from Ξ, moved by the real actions, filmed in part."""

import time

import numpy as np

from simtune.randomization import Distribution
from simtune.search_param_model.simulated import SimulatedWorlds, simulate
from simtune.trajectory import Trajectory
from simtune.tuning.search import SearchContext

_FEWEST_WORLDS = 64  # to learn anything from
_TIMED_WORLDS, _TIMED_STEPS = 32, 20


class WorldSampler:
    """Draws as many worlds as there is time for; it knows how long a step and a picture take."""

    def __init__(self, context: SearchContext, first: Distribution):
        """`first`: a distribution whose worlds are timed at once."""
        self._context, self.rng = context, np.random.default_rng(context.seed)
        self._step_s = _seconds_per_step(context, first)
        self._frame_s = 0.0

    def sample(
        self,
        real: list[Trajectory],
        distribution: Distribution,
        num_worlds: int,
        num_episodes: int,
        num_filmed: int,
        seconds: float,
    ) -> SimulatedWorlds:
        """Worlds that replay the actions of `num_episodes` real episodes; a stretch is filmed.

        `num_worlds` worlds, or fewer where they would take longer than `seconds`.
        """
        context, rng, steps = self._context, self.rng, min(len(t) for t in real)
        # Supersampling makes pictures expensive.
        num_filmed = max(2, num_filmed // context.simulator.supersampling)
        played_steps = num_episodes * steps
        world_s = self._step_s * played_steps + self._frame_s * num_filmed
        num = int(np.clip(seconds / world_s, min(_FEWEST_WORLDS, num_worlds), num_worlds))
        began_s = time.monotonic()
        actions = np.stack([t.actions[:steps] for t in real])
        which = np.stack([rng.permutation(len(real))[:num_episodes] for _ in range(num)])
        worlds = simulate(
            context.simulator,
            context.keypoints,
            distribution.sample(num, rng),
            actions[which],
            num_filmed,
            rng,
            context.observation,
        )
        world_s = (time.monotonic() - began_s) / num
        self._step_s = min(self._step_s, world_s / played_steps)
        self._frame_s = (world_s - self._step_s * played_steps) / num_filmed
        return worlds


def _seconds_per_step(context: SearchContext, distribution: Distribution) -> float:
    """Of one world's policy step, among many at once."""
    simulator, rng = context.simulator, np.random.default_rng((context.seed, 1))
    worlds = distribution.sample(_TIMED_WORLDS, rng)
    act = simulator.explore(_TIMED_WORLDS, _TIMED_STEPS, rng)
    simulator.play(worlds, act, 1, rng)  # what is made once is not counted
    began_s = time.monotonic()
    simulator.play(worlds, act, _TIMED_STEPS, rng)
    return max(1e-9, (time.monotonic() - began_s) / (_TIMED_WORLDS * _TIMED_STEPS))
