"""What the posterior SPM learns from: simulated worlds, of which only a part is drawn."""

from dataclasses import dataclass

import numpy as np

from simtune.simulation import AnySimulator, Points
from simtune.trajectory import delayed
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoints import Keypoints


@dataclass(frozen=True)
class SimulatedWorlds:
    """What one round of simulation gives: W worlds of E episodes of T steps each."""

    parameters: np.ndarray  # (W, N)
    actions: np.ndarray  # (W, E, T, A)
    keypoints: np.ndarray  # (W, E, T + 1, L, 2) pixels, true
    frames: np.ndarray  # (W, F, H, H, 3) uint8: F successive frames of each world's...
    filmed_from: np.ndarray  # (W,) ...first episode, from this step on
    states: np.ndarray  # (W, F, S) behind `frames`

    def filmed_keypoints(self) -> np.ndarray:
        """(W, F, L, 2) the true keypoints in `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1])
        return self.keypoints[np.arange(len(at))[:, None], 0, at]


def simulate(
    simulator: AnySimulator,
    keypoints: Keypoints | Points,
    parameters: np.ndarray,
    actions: np.ndarray,
    num_filmed: int,
    rng: np.random.Generator,
    image_noise: ImageNoise | None = None,
) -> SimulatedWorlds:
    """Play (W, E, T, A) actions in W worlds of (W, N) parameters, and film a stretch of each.

    With `image_noise` the actions come a step late in half of the worlds, as a real robot's may,
    unless a delay is among the parameters.
    Worlds of which an episode diverged are left out. Raises RuntimeError if hardly any is left.
    """
    num_episodes, steps = actions.shape[1:3]
    played = actions.astype(float)
    if image_noise and not simulator.space.is_delay.any():
        late = rng.random(len(actions)) < 0.5
        played[late] = delayed(played[late], 1)
    rollouts = simulator.roll_out(
        np.repeat(parameters, num_episodes, axis=0),
        played.reshape(len(played) * num_episodes, *actions.shape[2:]),  # there may be no actions
        rng,
        keypoints.record,
    )
    assert rollouts.recorded is not None, "asked for above"
    whole = whole_sets(rollouts.index, num_episodes)
    if len(whole) < 4:  # some to learn from, some to measure errors on
        raise RuntimeError("nearly every world diverged; check the timestep and the bounds")
    num_worlds, num_filmed = len(whole), min(num_filmed, steps + 1)
    start = rng.integers(0, steps + 2 - num_filmed, num_worlds)
    states = rollouts.states[whole[:, :1], start[:, None] + np.arange(num_filmed)]
    kept = rollouts.parameters[whole[:, 0]]
    frames = simulator.render(
        states.reshape(num_worlds * num_filmed, -1), np.repeat(kept, num_filmed, axis=0)
    )
    frames = frames.reshape(num_worlds, num_filmed, *frames.shape[1:])
    if image_noise:
        image_noise.apply(frames, rng)
    return SimulatedWorlds(
        kept,
        actions[rollouts.index[whole[:, 0]] // num_episodes],
        rollouts.recorded[whole].reshape(num_worlds, num_episodes, steps + 1, -1, 2),
        frames,
        start,
        states,
    )


def whole_sets(index: np.ndarray, episodes: int) -> np.ndarray:
    """(W, E) positions in `index` (n,) of the sets of E successive episodes that are all there."""
    _, start, count = np.unique(index // episodes, return_index=True, return_counts=True)
    return start[count == episodes, None] + np.arange(episodes)
