"""Uncertainty of poses in a picture, as far as the motion leaves them open."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.fit.physics import Physics
from simtune.simulation import Simulator
from simtune.simulation.states import StateSpace

_FIRST = 25  # places that show what changes between places
_MOST_PLACES = 300
_CLOSER = np.array([2.0, 4.0])  # times as close together, around the best place
_TIE = 1e-6  # of a correlation, by which a place far away must look more like the frame
_ALIKE = 0.05  # change between neighbours, in mean squares, relative to that between any places
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
    """(M, S) states, moved by up to ± a (2 nv,) tangent to where each looks most like its frame.

    Places are tried so close together that pictures of neighbours are alike. A floor whose texture
    repeats looks nearly right in many of them, and shows another brightness in each if a lamp hangs
    over one: whoever leaves out the right place finds wrong colours. Also returns the (2 nv,)
    distance at which pictures would be just so alike: errors up to it change a picture evenly.
    """
    real = frames.reshape(len(frames), -1).astype(np.float32)
    along = _Along(simulator, full_states, parameters, space, tangent)
    first = np.linspace(-1, 1, _FIRST)
    drawn = np.stack([along.draw(place) for place in first])
    changes = drawn.var(0)
    likeness = [_correlation(pictures, real, changes) for pictures in drawn]
    apart, share = along.alike_within(_best(first, likeness), changes)
    places = np.linspace(-1, 1, 2 * math.ceil(1 / apart) + 1)
    likeness = [_correlation(along.draw(place), real, changes) for place in places]
    found = _best(places, likeness)
    for closer in apart / _CLOSER:
        near = found + closer * np.array([[0.0], [-1.0], [1.0]])  # (3, M)
        likeness = [_correlation(along.draw(place), real, changes) for place in near]
        found = near[np.argmax(likeness, 0), np.arange(len(found))]
    return along.at(found), apart * np.abs(tangent) * max(1.0, _ALIKE / max(share, 1e-9))


class _Along:
    """Pictures of M states that are moved along a tangent."""

    def __init__(self, simulator, full_states, parameters, space, tangent):
        self._simulator, self._space, self._tangent = simulator, space, tangent
        self._full_states = full_states
        self._states = space.positions_and_velocities(full_states)
        self._worlds = np.repeat(parameters[None], len(full_states), 0)

    def at(self, places: np.ndarray | float) -> np.ndarray:
        """(M, S) states, moved by so many tangents, (M,) or all alike."""
        shifts = np.broadcast_to(places, len(self._states))[:, None] * self._tangent
        moved = self._space.move(self._states, shifts)
        return self._space.with_positions_and_velocities(self._full_states, moved)

    def draw(self, places: np.ndarray | float) -> np.ndarray:
        """(M, pixels)."""
        drawn = self._simulator.render(self.at(places), self._worlds)
        return drawn.reshape(len(drawn), -1).astype(np.float32)

    def alike_within(self, places: np.ndarray, changes: np.ndarray) -> tuple[float, float]:
        """How far from (M,) places pictures are alike, and their change, relative to `changes`.

        `changes`: (M, pixels) variance between any places.
        """
        here, apart = self.draw(places), 2 / (_FIRST - 1)
        while True:
            beside = self.draw(places - apart), self.draw(places + apart)
            sides = [np.square(pictures - here).sum(-1) for pictures in beside]
            # The smaller one: where a floor's edges all cross pixels at once, pictures jump.
            share = float(np.median(np.minimum(*sides) / np.maximum(2 * changes.sum(-1), 1e-9)))
            if share <= _ALIKE or 2 / apart >= _MOST_PLACES:
                return apart, share
            apart /= 2


def _best(places: np.ndarray, likeness: Sequence[np.ndarray]) -> np.ndarray:
    """(M,) of (P,) places, by (P, M) likeness."""
    return places[np.argmax(np.stack(likeness) - _TIE * np.abs(places)[:, None], 0)]


def _correlation(drawn: np.ndarray, real: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(M,) of (M, pixels) with (M, pixels), weighted by (M, pixels).

    Correlation, since the floor's brightness may still differ; weighted by how much a pixel changes
    between places, since the rest differs by other shares.
    """
    weight = weight / np.maximum(weight.sum(-1, keepdims=True), 1e-9)
    drawn = drawn - (weight * drawn).sum(-1, keepdims=True)
    real = real - (weight * real).sum(-1, keepdims=True)
    sizes = (weight * np.square(drawn)).sum(-1) * (weight * np.square(real)).sum(-1)
    return (weight * drawn * real).sum(-1) / np.sqrt(np.maximum(sizes, 1e-9))
