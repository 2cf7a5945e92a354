"""The initial state of a real episode, which its video does not show.

A fit finds it. Without one, this searches for the start whose first pictures look most like the
real ones, by elite resampling: many random starts, then many near the best.
"""

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.random_streams import Purpose, stream
from simtune.simulation import AnySimulator, Rollouts, Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.estimate import Estimate

_COMPARED_STEPS = 4  # the first pictures, which also show velocities
_NUM_ELITES = 8
_STARTS_PER_BATCH = 32  # between looks at the clock
_MIN_COVERED_SHARE = 0.1  # of the pixels that starts usually cover: fewer tell nothing


@dataclass(frozen=True, kw_only=True)
class StartSearchConfig:
    """How long the start of the real episode is searched for."""

    num_starts: int = 256  # random, then in each later round near the best
    rounds: int = 6
    seconds: float = 10.0  # after which no round begins: pictures of meshes take long


_DEFAULT_CONFIG = StartSearchConfig()


class _Tried(NamedTuple):
    """Starts, and how their first pictures compare with the real ones where they are drawn."""

    starts: np.ndarray  # (n, S)
    squares: np.ndarray  # (n,) sum of mean squared differences of the pixels that they cover
    covered: np.ndarray  # (n,) number of those pixels; all, unless the background is unknown

    def joined(self, more: "_Tried") -> "_Tried":
        return _Tried(*(np.append(mine, its, 0) for mine, its in zip(self, more, strict=True)))

    @property
    def distance(self) -> np.ndarray:
        """(n,) mean squared differences; infinite if hardly a pixel is covered.

        What is out of the picture differs in none. If that is so of all, all are equally near.
        """
        shown = self.covered[self.covered > 0]
        least = _MIN_COVERED_SHARE * np.median(shown) if len(shown) else 0.0
        mean = self.squares / np.maximum(self.covered, 1)
        return np.where(self.covered < least, np.inf, mean)

    def nearest(self, most: int) -> "_Tried":
        """At most so many, nearest first; none that is infinitely far."""
        distance = self.distance
        order = np.argsort(distance)[:most]
        order = order[np.isfinite(distance[order])]
        return _Tried(*(array[order] for array in self))


def episode_and_start(
    simulator: AnySimulator,
    trajectory: Trajectory,
    estimate: Estimate,
    seed: int,
    config: StartSearchConfig = _DEFAULT_CONFIG,
) -> tuple[Trajectory, np.ndarray]:
    """A real episode with its actions when they took effect, and its initial state (S,).

    It must be the episode that the estimate's start belongs to, if there is one.
    """
    late = replace(trajectory, actions=delayed(trajectory.actions, estimate.latency_steps))
    if estimate.start is not None:
        return late, np.array(estimate.start)
    return late, find_start(
        simulator, late, estimate.mean, stream(seed, Purpose.START_SEARCH), config
    )


def find_start(
    simulator: AnySimulator,
    trajectory: Trajectory,
    parameters: np.ndarray,
    rng: np.random.Generator,
    config: StartSearchConfig = _DEFAULT_CONFIG,
) -> np.ndarray:
    """(S,) state from which the simulator's first pictures are nearest to the real ones."""
    first = trajectory.first(_COMPARED_STEPS)
    at_once = min(config.num_starts, _STARTS_PER_BATCH)
    end = time.perf_counter() + config.seconds
    tried = _compare(simulator, first, parameters, rng, at_once)
    while len(tried.starts) < config.num_starts and time.perf_counter() < end - config.seconds / 2:
        tried = tried.joined(_compare(simulator, first, parameters, rng, at_once))
    num = len(tried.starts)
    space = simulator.state_space
    if space is None:  # worlds cannot start near other states
        return tried.nearest(1).starts[0]
    std = tried.starts.std(0)
    # State components that the task's own starts do not vary stay as they are.
    moving = space.positions_and_velocities(std)
    spread = space.with_positions_and_velocities(np.zeros_like(std), moving)
    for round_ in range(1, config.rounds):
        if time.perf_counter() > end:
            break
        tried = tried.nearest(_NUM_ELITES)
        starts = tried.starts[rng.integers(len(tried.starts), size=num)]
        starts = starts + spread * 0.5**round_ * rng.normal(size=starts.shape)
        tried = tried.joined(_compare(simulator, first, parameters, rng, num, starts))
    nearest = tried.nearest(1).starts
    return _play(simulator, first, parameters[None], rng, nearest).states[0, 0]


def _compare(
    simulator: AnySimulator,
    real: Trajectory,
    parameters: np.ndarray,
    rng: np.random.Generator,
    num: int,
    starts: np.ndarray | None = None,
) -> _Tried:
    """(num, S) starts, or the task's own, compared with the real pictures.

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
    squares = (difference * covered).sum((1, 2, 3))
    return _Tried(states[:, 0] if starts is None else starts, squares, covered.sum((1, 2, 3)))


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
