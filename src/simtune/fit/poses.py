"""Uncertainty of poses in a picture, as far as the motion leaves them open."""

import numpy as np

from simtune.fit.physics import Physics
from simtune.simulation import Simulator
from simtune.simulation.states import StateSpace

# Candidates per picture, at uneven distances: a texture may repeat at even ones
_PLACES = np.linspace(-1, 1, 25) * (0.8 + 0.2 * np.linspace(-1, 1, 25) ** 2)
_CLOSER = np.linspace(-1, 1, 5)  # then, between the neighbours of the best one
_MOST_TURNS = 9
_TIE = 1e-6  # of a correlation, by which a place far away must look more like the frame
_ALIKE = 0.1  # change between neighbours, in mean squares, relative to that between any places
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
) -> tuple[np.ndarray, np.ndarray]:
    """(M, S) states, each moved along a (2 nv,) tangent to where it looks most like its frame.

    Places are tried ever closer together, until pictures of neighbours are alike: a floor whose
    texture repeats looks right only near its right places. Also returns the (2 nv,) distance at
    which pictures would be just so alike: errors up to it change a picture evenly.
    """
    real = frames.reshape(len(frames), -1).astype(np.float32)
    states, each = space.positions_and_velocities(full_states), np.arange(len(full_states))
    worlds = np.repeat(parameters[None], len(states), 0)
    places, reach, changes, share = _PLACES, tangent, np.empty(0), 0.0
    for _ in range(_MOST_TURNS):
        shifts = places[:, None, None] * reach
        moved = space.move(states, np.repeat(shifts, len(states), 1))
        candidates = space.with_positions_and_velocities(full_states, moved)
        drawn = np.stack([simulator.render(place, worlds) for place in candidates])
        drawn = drawn.reshape(len(places), *real.shape).astype(np.float32)
        changes = changes if len(changes) else drawn.var(0)
        likeness = _correlation(drawn, real, changes)
        best = np.argmax(likeness - _TIE * np.abs(places)[:, None], 0)
        last = len(places) - 1
        beside = np.where(best > 0, best - 1, 1), np.where(best < last, best + 1, last - 1)
        change = [np.square(drawn[best, each] - drawn[other, each]).sum(-1) for other in beside]
        # The smaller one: where a floor's edges all cross pixels at once, pictures jump.
        share = float(np.median(np.minimum(*change) / np.maximum(2 * changes.sum(-1), 1e-9)))
        states, reach = moved[best, each], reach * np.diff(places).max()
        places = _CLOSER
        if share <= _ALIKE:
            break
    aligned = space.with_positions_and_velocities(full_states, states)
    return aligned, np.abs(reach) * max(1.0, _ALIKE / max(share, 1e-9))


def _correlation(drawn: np.ndarray, real: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(P, M) of (P, M, pixels) with (M, pixels), weighted by (M, pixels).

    Correlation, since the floor's brightness may still differ; weighted by how much a pixel changes
    between places, since the rest differs by other shares.
    """
    weight = weight / np.maximum(weight.sum(-1, keepdims=True), 1e-9)
    drawn = drawn - (weight * drawn).sum(-1, keepdims=True)
    real = real - (weight * real).sum(-1, keepdims=True)
    sizes = (weight * np.square(drawn)).sum(-1) * (weight * np.square(real)).sum(-1)
    return (weight * drawn * real).sum(-1) / np.sqrt(np.maximum(sizes, 1e-9))
