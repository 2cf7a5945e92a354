"""What the posterior SPM learns from: simulated worlds, of which only a part is drawn."""

from dataclasses import dataclass
from typing import overload

import numpy as np

from simtune.randomization import Distribution
from simtune.search_param_model.landmarks import (
    Landmarks,
    candidate_landmarks,
    choose_landmarks,
)
from simtune.simulation import AnySimulator, EnvironmentSimulator, Points, Simulator
from simtune.trajectory import delayed

PILOT_STEPS = 3200  # simulated to choose landmarks by
_PILOTS = 32


@dataclass(frozen=True)
class SimulatedWorlds:
    """What one round of simulation gives: W worlds of E episodes of T steps each."""

    parameters: np.ndarray  # (W, N)
    actions: np.ndarray  # (W, E, T, A)
    landmarks: np.ndarray  # (W, E, T + 1, L, 2) pixels, true
    frames: np.ndarray  # (W, F, H, H, 3) uint8: F successive frames of each world's...
    filmed_from: np.ndarray  # (W,) ...first episode, from this step on
    states: np.ndarray  # (W, F, S) behind `frames`

    def filmed_landmarks(self) -> np.ndarray:
        """(W, F, L, 2) the true landmarks in `frames`."""
        at = self.filmed_from[:, None] + np.arange(self.frames.shape[1])
        return self.landmarks[np.arange(len(at))[:, None], 0, at]


@dataclass(frozen=True)
class Camera:
    """What a real camera does to a picture and the simulator does not; other in each world.

    Not tuned, only randomised: sight learns to look past it, and its errors, which the judge is
    taught with, grow by what it cannot look past.
    """

    gain: float = 0.06  # standard deviation of the logarithm of brightness
    tint: float = 0.02  # the same, for each channel by itself
    offset: float = 0.02  # of the full scale
    noise: float = 0.025  # at most, of the full scale

    def film(self, frames: np.ndarray, rng: np.random.Generator) -> None:
        """Make (W, F, H, W, 3) uint8 as drawn, in place, what W cameras record of them."""
        for drawn in frames:
            gain = np.exp(rng.normal(0, self.gain) + rng.normal(0, self.tint, 3))
            offset = 255 * rng.normal(0, self.offset)
            noise = 255 * rng.uniform(0, self.noise)
            seen = _blurred(drawn.astype(np.float32), rng.uniform(0, 1)) * gain.astype(np.float32)
            seen += offset + noise * rng.standard_normal(seen.shape, np.float32)
            drawn[:] = np.rint(seen).clip(0, 255)


def _blurred(pictures: np.ndarray, share: float) -> np.ndarray:
    """(F, H, W, 3) pictures mixed with themselves, smoothed over a pixel to each side."""
    smooth = pictures
    for axis in (1, 2):
        smooth = (np.roll(smooth, 1, axis) + 2 * smooth + np.roll(smooth, -1, axis)) / 4
    return (1 - share) * pictures + share * smooth


def simulate(
    simulator: AnySimulator,
    landmarks: Landmarks | Points,
    parameters: np.ndarray,
    actions: np.ndarray,
    num_filmed: int,
    rng: np.random.Generator,
    camera: Camera | None = None,
) -> SimulatedWorlds:
    """Play (W, E, T, A) actions in W worlds of (W, N) parameters, and film a stretch of each.

    With a `camera` the actions come a step late in half of the worlds, as a real robot's may,
    unless a delay is among the parameters.
    Worlds of which an episode diverged are left out. Raises RuntimeError if hardly any is left.
    """
    num_episodes, steps = actions.shape[1:3]
    played = actions.astype(float)
    if camera and not simulator.space.is_delay.any():
        late = rng.random(len(actions)) < 0.5
        played[late] = delayed(played[late], 1)
    rollouts = simulator.roll_out(
        np.repeat(parameters, num_episodes, axis=0),
        played.reshape(len(played) * num_episodes, *actions.shape[2:]),  # there may be no actions
        rng,
        landmarks.record,
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
    if camera:
        camera.film(frames, rng)
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


@overload
def find_landmarks(
    simulator: Simulator, camera: str, distribution: Distribution, seed: int
) -> Landmarks: ...
@overload
def find_landmarks(
    simulator: AnySimulator, camera: str, distribution: Distribution, seed: int
) -> Landmarks | Points: ...
def find_landmarks(
    simulator: AnySimulator, camera: str, distribution: Distribution, seed: int
) -> Landmarks | Points:
    """Few landmarks from which all others follow, judged by a few exploring episodes."""
    rng = np.random.default_rng(seed)
    if isinstance(simulator, Simulator):
        every = candidate_landmarks(simulator.model, camera, simulator.image_size)
    else:
        assert isinstance(simulator, EnvironmentSimulator)
        every = simulator.points()
    if not len(every):
        return every
    steps = PILOT_STEPS // _PILOTS
    act, parameters = simulator.explore(_PILOTS, steps, rng), distribution.sample(_PILOTS, rng)
    rollouts = simulator.play(parameters, act, steps, rng, watch=every.record).episodes(parameters)
    assert rollouts.recorded is not None, "asked for above"
    return every.select(choose_landmarks(rollouts.recorded.reshape(-1, len(every), 2)))
