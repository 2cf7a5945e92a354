"""Videos with the same actions: the real episode, the simulator before and after tuning.

A video does not show its initial state. A fit finds it; without one, the start whose first pictures
look most like the real ones is searched for: many random ones, then many near the best.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from simtune.before_after.unexplained import marked, unexplained
from simtune.recordings import write_video
from simtune.simulation import AnySimulator, Rollouts, Simulator
from simtune.trajectory import Trajectory, delayed, seen_late
from simtune.tuning.estimate import Estimate

_COMPARED_STEPS = 4  # the first pictures, which also show velocities
_ELITE = 8
_WORTH_A_LOOK = 0.002  # share of pixels that are not explained
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


def write_videos(
    folder: Path,
    simulator: AnySimulator,
    trajectory: Trajectory,
    start: np.ndarray,
    parameters: tuple[np.ndarray, np.ndarray],
    late_steps: float = 0.0,
) -> None:
    """Write real.mp4, before.mp4, after.mp4, overlay.mp4 of one real episode from its `start` (S,).

    And unexplained.mp4, if the simulator explains parts of the pictures badly. `parameters`: (N,)
    before and after; `late_steps`: by which pictures are late.
    """
    fps = round(1 / trajectory.step_s, 3)
    write_video(folder / "real.mp4", trajectory.frames, fps)
    before, after = (film_from(simulator, trajectory, p, start, late_steps) for p in parameters)
    write_video(folder / "before.mp4", before, fps)
    write_video(folder / "after.mp4", after, fps)
    write_video(folder / "overlay.mp4", overlay(trajectory.frames, after), fps)
    filmed = trajectory.frames[: len(after)]
    where = unexplained(filmed, after)
    (folder / "unexplained.mp4").unlink(missing_ok=True)  # of an earlier round
    if where.mean() > _WORTH_A_LOOK:
        write_video(folder / "unexplained.mp4", marked(filmed, where), fps)


def overlay(real: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """Two films (T, H, W, 3) uint8 as one: grey where alike, red where only the real is brighter.

    Cyan where only the simulated one is. The shorter one's last picture stays.
    """
    last = len(simulated) - 1
    ends = np.minimum(np.arange(len(real)), last)
    one, other = (film.mean(-1) for film in (real, simulated[ends]))
    return np.rint(np.stack([one, other, other], -1)).astype(np.uint8)


def find_start(
    simulator: AnySimulator,
    trajectory: Trajectory,
    parameters: np.ndarray,
    rng: np.random.Generator,
    config: StartSearchConfig = _USUAL,
) -> np.ndarray:
    """(S,) state from which the simulator's first pictures are nearest to the real ones."""
    first, at_once = trajectory.first(_COMPARED_STEPS), min(config.num_starts, _AT_ONCE)
    end = time.perf_counter() + config.seconds
    states, distance = _compare(simulator, first, parameters, rng, at_once)
    while len(states) < config.num_starts and time.perf_counter() < end - config.seconds / 2:
        more, its_distance = _compare(simulator, first, parameters, rng, at_once)
        states, distance = np.append(states, more, 0), np.append(distance, its_distance)
    num = len(states)
    space, std = simulator.state_space, states.std(0)
    if space is None:  # worlds cannot start near other states
        return states[np.argmin(distance)]
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
    frames, states = simulator.film(rollouts), rollouts.states
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
    if starts is None or not isinstance(simulator, Simulator):
        return simulator.roll_out(worlds, actions, rng, starts=starts, keep_diverged=True)
    act, num_steps = (lambda t, _: actions[:, t]), actions.shape[1]
    return simulator.play(worlds, act, num_steps, rng, starts=starts, is_beginning=True)


def film_from(
    simulator: AnySimulator,
    real: Trajectory,
    parameters: np.ndarray,
    start: np.ndarray,
    late_steps: float = 0.0,
) -> np.ndarray:
    """(T + 1, H, W, 3) of a world with a real episode's actions; its start alone if it diverges.

    An unknown background is the real one's. `late_steps`: by which pictures are late.
    """
    rng = np.random.default_rng(0)  # not used: the start is given
    world, starts = parameters[None], start[None]
    rollouts = simulator.roll_out(world, real.actions[None].astype(float), rng, starts=starts)
    states = seen_late(rollouts.states[0], late_steps) if len(rollouts) else starts
    worlds = np.repeat(world, len(states), 0)
    drawn, covered = simulator.render(states, worlds), simulator.covers(states, worlds)
    return np.where(covered[..., None], drawn, real.frames[: len(states)])
