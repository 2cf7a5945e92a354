"""The initial state of a real episode, which its video does not show.

A fit finds it. Without one, this searches for the start whose first pictures look most like the
real ones, by elite resampling: many random starts, then many near the best.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from simtune.simulation import AnySimulator, Rollouts, Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.estimate import Estimate

_COMPARED_STEPS = 4  # the first pictures, which also show velocities
_ELITE = 8
_AT_ONCE = 32  # starts that are tried between looks at the clock


@dataclass(frozen=True, kw_only=True)
class StartSearchConfig:
    """How long the start of the real episode is searched for."""

    num_starts: int = 256  # random, then in each later round near the best
    rounds: int = 6
    seconds: float = 10.0  # after which no round begins: pictures of meshes take long


_USUAL = StartSearchConfig()


def episode_and_start(
    simulator: AnySimulator,
    trajectory: Trajectory,
    estimate: Estimate,
    seed: int,
    config: StartSearchConfig = _USUAL,
) -> tuple[Trajectory, np.ndarray]:
    """A real episode with its actions when they took effect, and its initial state (S,).

    It must be the episode that the estimate's start belongs to, if there is one.
    """
    late = replace(trajectory, actions=delayed(trajectory.actions, estimate.latency_steps))
    if estimate.start is not None:
        return late, np.array(estimate.start)
    return late, find_start(simulator, late, estimate.mean, np.random.default_rng(seed), config)


def find_start(
    simulator: AnySimulator,
    trajectory: Trajectory,
    parameters: np.ndarray,
    rng: np.random.Generator,
    config: StartSearchConfig = _USUAL,
) -> np.ndarray:
    """(S,) state from which the simulator's first pictures are nearest to the real ones."""
    first = trajectory.first(_COMPARED_STEPS)
    at_once = min(config.num_starts, _AT_ONCE)
    end = time.perf_counter() + config.seconds
    states, distance = _compare(simulator, first, parameters, rng, at_once)
    while len(states) < config.num_starts and time.perf_counter() < end - config.seconds / 2:
        more, its_distance = _compare(simulator, first, parameters, rng, at_once)
        states, distance = np.append(states, more, 0), np.append(distance, its_distance)
    num = len(states)
    space = simulator.state_space
    if space is None:  # worlds cannot start near other states
        return states[np.argmin(distance)]
    std = states.std(0)
    # State components that the task's own starts do not vary stay as they are.
    moving = space.positions_and_velocities(std)
    spread = space.with_positions_and_velocities(np.zeros_like(std), moving)
    for round_ in range(1, config.rounds):
        if time.perf_counter() > end:
            break
        nearest = np.argsort(distance)[:_ELITE]
        states, distance = states[nearest], distance[nearest]
        starts = states[rng.integers(len(nearest), size=num)]
        starts = starts + spread * 0.5**round_ * rng.normal(size=starts.shape)
        more, its_distance = _compare(simulator, first, parameters, rng, num, starts)
        states, distance = np.append(states, more, 0), np.append(distance, its_distance)
    nearest = states[np.argmin(distance)][None]
    return _play(simulator, first, parameters[None], rng, nearest).states[0, 0]


def _compare(
    simulator: AnySimulator,
    real: Trajectory,
    parameters: np.ndarray,
    rng: np.random.Generator,
    num: int,
    starts: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(num, S) starts, or the task's own, and (num,) distances of pictures from the real ones.

    A model's starts are those before any action: what actuators remember goes with each start.
    """
    worlds = np.repeat(parameters[None], num, axis=0)
    if starts is None and isinstance(simulator, Simulator):
        starts = simulator.begin(worlds, rng).states[:, 0]
    rollouts = _play(simulator, real, worlds, rng, starts)
    frames = simulator.film(rollouts)
    states = rollouts.states
    difference = np.square(frames.astype(np.float32) - real.frames).mean(-1)
    steps = states.shape[1]
    covered = simulator.covers(states.reshape(num * steps, -1), np.repeat(worlds, steps, 0))
    covered = covered.reshape(difference.shape)
    distance = (difference * covered).sum((1, 2, 3)) / np.maximum(covered.sum((1, 2, 3)), 1)
    return states[:, 0] if starts is None else starts, distance


def _play(
    simulator: AnySimulator,
    real: Trajectory,
    worlds: np.ndarray,
    rng: np.random.Generator,
    starts: np.ndarray | None,
) -> Rollouts:
    """A real episode's actions in (n, N) worlds, from (n, S) starts; None: the task's own."""
    actions = np.repeat(real.actions[None].astype(float), len(worlds), axis=0)
    return simulator.roll_out(
        worlds, actions, rng, starts=starts, keep_diverged=True, is_beginning=True
    )
