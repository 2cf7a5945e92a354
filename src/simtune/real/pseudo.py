"""A simulated world that plays the real one."""

from dataclasses import replace
from typing import Any

import numpy as np

from simtune.observation import ObservationModel
from simtune.real.gap import RealityGap
from simtune.simulation import AnySimulator, PixelPolicy, Projector, Simulator, on_pictures
from simtune.trajectory import Trajectory


class PseudoReal:
    """A world of fixed parameters that only `collect` can be asked of.

    The parameters are kept out of reach: whoever tunes gets frames and actions, as from a
    robot. Scoring takes the truth from whoever made this world, not from here. Through a `gap`
    it is filmed as its camera sees it, and plays actions as late as it says.
    """

    def __init__(
        self,
        simulator: AnySimulator,
        parameters: np.ndarray,
        *,
        episode_steps: int,
        seed: int,
        gap: RealityGap | None = None,
    ):
        first_rng = np.random.default_rng(seed)
        delay_steps = gap.delay_steps if gap else 0
        of = ObservationModel.of_reality if gap else ObservationModel.of_simulator
        self.observation = of()
        self.step_s = step_s = simulator.step_s

        def film(num_episodes: int) -> list[Trajectory]:
            rng, worlds = first_rng, np.tile(parameters, (num_episodes, 1))
            explore = simulator.explore(num_episodes, episode_steps, rng)
            coming = np.zeros((num_episodes, episode_steps + delay_steps, simulator.num_actions))

            def act(t: int, states: np.ndarray) -> np.ndarray:
                if t < episode_steps:
                    coming[:, t + delay_steps] = explore(t, states)
                return coming[:, t]

            rollouts = simulator.play(worlds, act, coming.shape[1], rng).episodes(worlds)
            if not len(rollouts):
                raise RuntimeError(
                    "every episode of the pseudo-real world diverged, or ended before its "
                    f"{episode_steps} steps"
                )
            seen = replace(rollouts, states=rollouts.states[:, : episode_steps + 1])
            commanded = rollouts.actions[:, delay_steps:].astype(np.float32)
            return [
                Trajectory(gap.film(frames, step_s, rng) if gap else frames, asked, step_s)
                for frames, asked in zip(simulator.film(seen), commanded, strict=True)
            ]

        def run_policy(
            policy: PixelPolicy, num_stacked: int, num_episodes: int, rng: np.random.Generator
        ) -> list[Trajectory]:
            assert isinstance(simulator, Simulator), "nobody trains in an environment"
            worlds = np.tile(parameters, (num_episodes, 1))
            projector = Projector(simulator, worlds, episode_steps, num_stacked)

            act = on_pictures(simulator, projector, policy)
            played = simulator.play(worlds, act, episode_steps, rng)
            projector.show(episode_steps, played.states[:, -1])
            whole = np.flatnonzero(played.lengths == episode_steps)
            actions = played.actions.astype(np.float32)
            return [Trajectory(projector.frames[i], actions[i], step_s) for i in whole]

        self._film, self._run_policy, self._seed = film, run_policy, seed

    @property
    def facts(self) -> dict[str, Any]:
        """None: whoever made this world knows them, and keeps them."""
        return {}

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """Film exploring episodes, by default 5. Worlds that diverge yield fewer."""
        return self._film(num_episodes or 5)

    def run_policy(
        self, policy: PixelPolicy, num_stacked: int, num_episodes: int, seed: int
    ) -> list[Trajectory]:
        """See `RealWorld`; the same policy and seed give the same episodes. Without a gap only."""
        if not self.observation.same_renderer:
            raise NotImplementedError("no policy can act through a reality gap")
        return self._run_policy(
            policy, num_stacked, num_episodes, np.random.default_rng((self._seed, 2, seed))
        )
