"""Uncertainty of poses in a picture, as far as the motion leaves them open."""

import math
from collections.abc import Callable, Iterable

import numpy as np

from simtune.fit.physics import Physics
from simtune.simulation import StateSpace

# Places that show what changes between places; uneven, since a texture may repeat at even ones
_FIRST_PLACES = np.linspace(-1, 1, 25) * (0.8 + 0.2 * np.linspace(-1, 1, 25) ** 2)
_MOST_PLACES = 400
_PLACES_PER_PIXEL = 4.0  # to one side, at most: neighbours are half to one apart
_UNREPEATED_SHARE = 0.62  # of a distance, at which a texture that repeats at this distance does not
_REFINEMENTS = np.array([2.0, 4.0])  # times as close together, around the best place
_DISTANCE_PENALTY = 1e-6  # of a correlation: a place far away must look more like the frame
_NEIGHBOUR_CHANGE = 0.05  # in mean squares, relative to that between any places
_DELTA = 0.01  # finite-difference step, of a position's prior std
_MIN_CHANGE = 0.2  # of a keypoint, relative to its noise, that a picture's colours notice


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
    At most `largest`, (2 nv,); 0: known. Positions that joint readings determine so well that no
    picture shows the rest are left out; the first `num_shown` observations are those of pictures.
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
    # What readings leave open may show in ways that keypoints miss: a turning ball.
    is_read = (slopes[..., num_shown:] != 0).any((1, 2))
    shows = np.abs(slopes[..., :num_shown] * std.T[..., None]).max((1, 2), initial=0) > _MIN_CHANGE
    open_to = ~is_read | shows
    return (std[..., None] * np.eye(2 * nv)[unknown])[:, open_to]


def align_to_images(
    render: Callable[[np.ndarray, np.ndarray], np.ndarray],
    frames: np.ndarray,
    full_states: np.ndarray,
    parameters: np.ndarray,
    space: StateSpace,
    tangent: np.ndarray,
    shift_px: float = np.inf,
) -> tuple[np.ndarray, np.ndarray]:
    """(M, S) states, moved by up to ± a (2 nv,) tangent to where each looks most like its frame.

    `render`: as `Simulator.render`. `shift_px`: how far the tangent moves anything in the picture.
    Places are tried so close together that neighbouring pictures look alike, or are less than a
    pixel apart, or 400 of them. A repeating floor looks nearly right in many places, and a lamp
    makes each differently bright, so missing the right one gives wrong colours.

    Also returns the (2 nv,) distance at which pictures are barely alike, or that between places if
    it is larger: errors up to it change a picture evenly.
    """
    real = frames.reshape(len(frames), -1).astype(np.float32)
    along = _Along(render, full_states, parameters, space, tangent)
    drawn = np.stack([along.draw(place) for place in _FIRST_PLACES])
    changes = np.stack([places.astype(np.float32).var(0) for places in drawn.swapaxes(0, 1)])

    def likeness(pictures: Iterable[np.ndarray]) -> np.ndarray:
        return np.stack([_correlation(some, real, changes) for some in pictures])

    most = min(_MOST_PLACES, _PLACES_PER_PIXEL * shift_px)
    apart, share = along.alike_within(_best(_FIRST_PLACES, likeness(drawn)), changes, most)
    places = np.linspace(-1, 1, 2 * math.ceil(1 / apart) + 1)
    found = _best(places, likeness(map(along.draw, places)))
    for closer in apart / _REFINEMENTS:
        near = found + closer * np.array([[0.0], [-1.0], [1.0]])  # (3, M)
        best = np.argmax(likeness(map(along.draw, near)), 0)
        found = near[best, np.arange(len(found))].clip(-1, 1)
    return along.at(found), apart * np.abs(tangent) * max(1.0, _NEIGHBOUR_CHANGE / max(share, 1e-9))


class _Along:
    """Pictures of M states that are moved along a tangent."""

    def __init__(self, render, full_states, parameters, space, tangent):
        self._render, self._space, self._tangent = render, space, tangent
        self._full_states = full_states
        self._states = space.positions_and_velocities(full_states)
        self._worlds = np.repeat(parameters[None], len(full_states), 0)

    def at(self, places: np.ndarray | float) -> np.ndarray:
        """(M, S) states, moved by so many tangents, (M,) or all alike."""
        shifts = np.broadcast_to(places, len(self._states))[:, None] * self._tangent
        moved = self._space.move(self._states, shifts)
        return self._space.with_positions_and_velocities(self._full_states, moved)

    def draw(self, places: np.ndarray | float) -> np.ndarray:
        """(M, pixels) uint8."""
        drawn = self._render(self.at(places), self._worlds)
        return drawn.reshape(len(drawn), -1)

    def alike_within(
        self, places: np.ndarray, changes: np.ndarray, most_places: float
    ) -> tuple[float, float]:
        """How far from (M,) places pictures are alike, and their change, relative to `changes`.

        `changes`: (M, pixels) variance between any places. No closer than `most_places` are.
        """
        here, apart = self.draw(places).astype(np.float32), 2 / len(_FIRST_PLACES)
        while True:
            change = np.maximum(
                self._change(here, places, apart),
                self._change(here, places, _UNREPEATED_SHARE * apart),
            )
            share = float(np.median(change / np.maximum(2 * changes.sum(-1), 1e-9)))
            if share <= _NEIGHBOUR_CHANGE or 4 / apart > most_places:
                return apart, share
            apart /= 2

    def _change(self, here: np.ndarray, places: np.ndarray, away: float) -> np.ndarray:
        """(M,) sums of squares between pictures `here`, at `places`, and `away` from them.

        To the side where it is smaller: where a floor's edges all cross pixels at once, it jumps.
        """
        beside = self.draw(places - away), self.draw(places + away)
        return np.minimum(*[np.square(pictures - here).sum(-1) for pictures in beside])


def _best(places: np.ndarray, likeness: np.ndarray) -> np.ndarray:
    """(M,) of (P,) places, by (P, M) likeness."""
    return places[np.argmax(likeness - _DISTANCE_PENALTY * np.abs(places)[:, None], 0)]


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
