"""Videos with the same actions: the real episode, the simulator before and after tuning."""

from pathlib import Path

import numpy as np

from simtune.before_after.unexplained import marked, unexplained
from simtune.fit import states_in_late_pictures
from simtune.recordings import write_video
from simtune.simulation import AnySimulator, Simulator
from simtune.trajectory import Trajectory

_MIN_UNEXPLAINED_SHARE = 0.002  # of pixels, from which a video is written


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
    if where.mean() > _MIN_UNEXPLAINED_SHARE:
        write_video(folder / "unexplained.mp4", marked(filmed, where), fps)


def overlay(real: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """Two films (T, H, W, 3) uint8 as one: grey where alike, red where only the real is brighter.

    Cyan where only the simulated one is. The shorter one's last picture stays.
    """
    last = len(simulated) - 1
    ends = np.minimum(np.arange(len(real)), last)
    one, other = (film.mean(-1) for film in (real, simulated[ends]))
    return np.rint(np.stack([one, other, other], -1)).astype(np.uint8)


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
    states = rollouts.states[0] if len(rollouts) else starts
    if isinstance(simulator, Simulator):
        states = states_in_late_pictures(simulator, states, late_steps)
    worlds = np.repeat(world, len(states), 0)
    drawn, covered = simulator.render(states, worlds), simulator.covers(states, worlds)
    return np.where(covered[..., None], drawn, real.frames[: len(states)])
