"""A simulated world in the role of the real one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from simtune.observation import ObservationModel
from simtune.random_streams import Purpose, stream
from simtune.real import RealWorld, remembers_nothing
from simtune.real.gap import RealityGap
from simtune.simulation import (
    AnySimulator,
    FrameStacker,
    PixelPolicy,
    Rollouts,
    acting_late,
    on_pictures,
)
from simtune.trajectory import Trajectory


class PseudoReal(RealWorld):
    """A world of fixed parameters; see `RealWorld`.

    The parameters are inaccessible: a search gets frames and actions, as from a robot. Scoring gets
    the truth from `Truth`, which made this world. With a `gap`, the gap's camera films the world,
    and actions take effect late. `observation`: what is recorded, by default pictures only.
    """

    def __init__(
        self,
        simulator: AnySimulator,
        parameters: np.ndarray,
        *,
        episode_steps: int,
        seed: int,
        gap: RealityGap | None = None,
        observation: ObservationModel | None = None,
    ):
        first_rng = stream(seed, Purpose.FIRST_FILM)
        self.observation = seen = observation or _usual(gap)
        self.step_s = simulator.step_s

        # Closures, so that no attribute exposes the parameters
        def film(num_episodes: int) -> list[Trajectory]:
            worlds = np.tile(parameters, (num_episodes, 1))
            return _film_exploring(simulator, worlds, episode_steps, first_rng, gap, seen)

        def run_policy(
            policy: PixelPolicy, num_stacked: int, num_episodes: int, rng: np.random.Generator
        ) -> list[Trajectory]:
            worlds = np.tile(parameters, (num_episodes, 1))
            camera = gap.camera(simulator.step_s, rng) if gap else None
            stacker = FrameStacker(simulator, worlds, episode_steps, num_stacked, camera)
            delay_steps = gap.delay_steps if gap else 0
            return _film_policy(simulator, worlds, stacker, policy, delay_steps, seen, rng)

        self._film, self._run_policy, self._seed = film, run_policy, seed

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """Film exploring episodes, by default 5. Worlds that diverge yield fewer."""
        return self._film(num_episodes or 5)

    def run_policy(
        self,
        policy: PixelPolicy,
        num_stacked: int,
        num_episodes: int,
        seed: int,
        begin: Callable[[], None] = remembers_nothing,
    ) -> list[Trajectory]:
        """See `RealWorld`; the same policy and seed give the same episodes."""
        begin()
        return self._run_policy(
            policy, num_stacked, num_episodes, stream(self._seed, Purpose.POLICY_FILM, seed)
        )


def _film_exploring(
    simulator: AnySimulator,
    worlds: np.ndarray,
    num_steps: int,
    rng: np.random.Generator,
    gap: RealityGap | None,
    observation: ObservationModel,
) -> list[Trajectory]:
    """Exploring episodes of (n, N) worlds; diverging ones are left out.

    Raises RuntimeError if all diverge.
    """
    delay_steps = gap.delay_steps if gap else 0
    explore = simulator.explore(len(worlds), num_steps, rng)

    def command(t: int, states: np.ndarray) -> np.ndarray:
        return explore(min(t, num_steps - 1), states)  # what comes later is not carried out

    act, until = acting_late(command, delay_steps), num_steps + delay_steps
    see = observation.observe_beside() if observation.sensors else None
    rollouts = simulator.play(worlds, act, until, rng, observe=see).finished()
    if not len(rollouts):
        raise RuntimeError(
            f"every episode of the pseudo-real world diverged, or ended before its {num_steps} "
            "steps"
        )
    seen = replace(
        rollouts,
        states=rollouts.states[:, : num_steps + 1],
        actions=rollouts.actions[:, delay_steps:],
        observed=rollouts.observed[:, : num_steps + 1],
    )
    return _filmed(simulator, seen, rng, gap, observation)


def _filmed(
    simulator: AnySimulator,
    seen: Rollouts,
    rng: np.random.Generator,
    gap: RealityGap | None,
    observation: ObservationModel,
) -> list[Trajectory]:
    """Trajectories of rollouts; a gap's cameras have their own noise."""
    films = [camera.footage for camera in observation.cameras]
    if gap:
        observation = ObservationModel.of_simulator(observation.sensors, films)
    recorded = observation.record(simulator, seen, rng)
    if not gap or not films:
        return recorded
    return [
        replace(filmed, frames=gap.film(filmed.frames, simulator.step_s, rng))
        for filmed in recorded
    ]


def _usual(gap: RealityGap | None) -> ObservationModel:
    return ObservationModel.of_reality() if gap else ObservationModel.of_simulator()


def _film_policy(
    simulator: AnySimulator,
    worlds: np.ndarray,
    stacker: FrameStacker,
    policy: PixelPolicy,
    delay_steps: int,
    observation: ObservationModel,
    rng: np.random.Generator,
) -> list[Trajectory]:
    """Episodes of a policy in (n, N) worlds filmed by `stacker`; diverging ones are left out.

    The recorded actions are the policy's commands, which take effect `delay_steps` later.
    """
    num_steps, num_actions = stacker.frames.shape[1] - 1, simulator.num_actions
    commands = np.zeros((len(worlds), num_steps, num_actions), np.float32)
    decide = on_pictures(simulator, stacker, policy)

    def command(t: int, states: np.ndarray) -> np.ndarray:
        commands[:, t] = actions = decide(t, states)
        return actions

    act = acting_late(command, delay_steps)
    see = observation.observe_beside() if observation.sensors else None
    rollouts = simulator.play(worlds, act, num_steps, rng, observe=see)
    stacker.draw(num_steps, rollouts.states[:, -1])
    readings = observation.readings(rollouts.observed, rng)
    return [
        Trajectory(
            stacker.frames[i],
            commands[i],
            simulator.step_s,
            {name: values[i] for name, values in readings.items()},
        )
        for i in rollouts.finished().index
    ]
