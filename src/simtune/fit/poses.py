"""Uncertainty of poses in a picture, as far as the motion leaves them open."""

import numpy as np

from simtune.fit.physics import Physics
from simtune.simulation import Simulator
from simtune.simulation.states import StateSpace

_PLACES = 25  # candidates per picture
_DELTA = 0.01  # finite-difference step, of a position's prior std
_SHOWS = 0.2  # least change of a keypoint, relative to its noise, that a picture's colours notice


def uncertain_poses(
    physics: Physics,
    full_states: np.ndarray,
    parameters: np.ndarray,
    scale: np.ndarray,
    num_shown: int,
    largest: np.ndarray,
) -> np.ndarray:
    """(M, D, 2 nv) changes of (M, S) states, of positions only, by one standard deviation each.

    It is what a single frame leaves open of each position alone, if its observations have noise
    `scale`, (K,). Other frames say more, unless the detector's errors are the same in all of them.
    At most `largest`, (2 nv,); 0: known. Positions that joint readings tell so well that no picture
    shows what is left open are left out; the first `num_shown` observations are those of pictures.
    """
    space, num = physics.space, len(full_states)
    nv, states = space.nv, physics.states(full_states)
    unknown = np.flatnonzero(largest[:nv])  # F of them
    delta = np.maximum(_DELTA * largest[unknown], 1e-9)
    tangents = np.zeros((1 + len(unknown), 1, 2 * nv))
    tangents[1 + np.arange(len(unknown)), 0, unknown] = delta
    moved = space.move(states, np.repeat(tangents, num, 1)).reshape(len(tangents) * num, -1)
    seen = physics.predict(moved, physics.parameters.to_unit(parameters))
    seen = seen.reshape(len(tangents), num, -1) / scale
    slopes = (seen[1:] - seen[:1]) / delta[:, None, None]  # (F, M, K)
    information = np.square(slopes).sum(-1).T  # (M, F)
    std = 1 / np.sqrt(information + largest[unknown] ** -2.0)
    # What readings do not tell may show in ways that keypoints miss: a turning ball.
    is_read = (slopes[..., num_shown:] != 0).any((1, 2))
    shows = np.abs(slopes[..., :num_shown] * std.T[..., None]).max((1, 2), initial=0) > _SHOWS
    open_to = ~is_read | shows
    return (std[..., None] * np.eye(2 * nv)[unknown])[:, open_to]


def align_to_images(
    simulator: Simulator,
    frames: np.ndarray,
    full_states: np.ndarray,
    parameters: np.ndarray,
    space: StateSpace,
    tangent: np.ndarray,
) -> np.ndarray:
    """(M, S) states, each moved along a (2 nv,) tangent to where it looks most like its frame."""
    shifts = np.linspace(-1, 1, _PLACES)[:, None, None] * tangent
    states = space.positions_and_velocities(full_states)
    moved = space.move(states, shifts + np.zeros((_PLACES, len(full_states), 1)))
    candidates = space.with_positions_and_velocities(full_states, moved)
    worlds = np.repeat(parameters[None], _PLACES * len(full_states), 0)
    drawn = simulator.render(candidates.reshape(-1, full_states.shape[-1]), worlds)
    drawn = drawn.reshape(_PLACES, len(full_states), -1)
    real = frames.reshape(len(frames), -1).astype(np.float32)
    # Correlation, since brightness may still differ.
    alike = [[np.corrcoef(d, r)[0, 1] for d, r in zip(place, real, strict=True)] for place in drawn]
    return candidates[np.argmax(alike, 0), np.arange(len(full_states))]
