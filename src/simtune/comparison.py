"""The same actions side by side: the real episode, the simulator before and after tuning.

A video does not say what state it starts from, so the start whose first pictures look most like
the real ones is searched for: many random starts, then many near the best.
"""

from pathlib import Path

import numpy as np

from simtune.recordings import write_video
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory

_NUM_STARTS = 256
_ROUNDS = 4
_COMPARED_STEPS = 4  # the first pictures, which also tell velocities
_ELITE = 8


def write_comparison(
    folder: Path,
    simulator: Simulator,
    trajectory: Trajectory,
    before: np.ndarray,
    after: np.ndarray,
    seed: int,
) -> None:
    """Write real.mp4, before.mp4, after.mp4 of one real episode and (N,) parameters."""
    start = find_start(simulator, trajectory, after, np.random.default_rng(seed))
    fps = round(1 / trajectory.step_s, 3)
    write_video(folder / "real.mp4", trajectory.frames, fps)
    for name, parameters in (("before", before), ("after", after)):
        frames = _film(simulator, trajectory.actions, parameters, start)
        write_video(folder / f"{name}.mp4", frames, fps)


def find_start(
    simulator: Simulator, trajectory: Trajectory, parameters: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(S,) the state from which the simulator's first pictures are nearest to the real ones."""
    steps = min(_COMPARED_STEPS, len(trajectory))
    actions = np.repeat(trajectory.actions[None, :steps].astype(float), _NUM_STARTS, axis=0)
    worlds = np.repeat(parameters[None], _NUM_STARTS, axis=0)
    real = trajectory.frames[: steps + 1].astype(np.float32)
    starts = None
    best: tuple[float, np.ndarray] | None = None
    for round_ in range(_ROUNDS):
        rollouts = simulator.roll_out(worlds, actions, rng, starts=starts)
        frames = simulator.film(rollouts).astype(np.float32)
        distance = np.square(frames - real).mean((1, 2, 3, 4))
        elite = rollouts.states[np.argsort(distance)[:_ELITE], 0]
        if best is None or distance.min() < best[0]:
            best = (float(distance.min()), elite[0])
        starts = _near(np.concatenate([best[1][None], elite]), simulator, 0.3**round_, rng)
    assert best is not None
    return best[1]


def _near(elite: np.ndarray, simulator: Simulator, width: float, rng: np.random.Generator):
    """(_NUM_STARTS, S) states near the elite's: positions and velocities moved a little."""
    starts = elite[rng.integers(len(elite), size=_NUM_STARTS)].copy()
    model = simulator.model
    moved = slice(1, 1 + model.nq + model.nv)  # a state row is time, qpos, qvel, ...
    starts[:, moved] += 0.1 * width * rng.normal(size=starts[:, moved].shape)
    return starts


def _film(
    simulator: Simulator, actions: np.ndarray, parameters: np.ndarray, start: np.ndarray
) -> np.ndarray:
    rng = np.random.default_rng(0)  # unused: the start is given
    rollouts = simulator.roll_out(
        parameters[None], actions[None].astype(float), rng, starts=start[None]
    )
    if not len(rollouts):  # it diverged: show the start alone
        return simulator.render(start[None], parameters[None])
    return simulator.film(rollouts)[0]
