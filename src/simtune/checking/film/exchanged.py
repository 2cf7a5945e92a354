"""Cameras whose films look exchanged, told by what moves in them alone."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from simtune.checking.film.camera_film import CameraFilm
from simtune.checking.film.features import Features, describe, likeness
from simtune.checking.film.library import Library

_MIN_SIMILARITY_RATIO = 1.1  # of two films in each other's place to their own
_MAX_ASPECT_FACTOR = 1.1  # between widths over heights: a lens makes 4:3 a little wider


def exchanged(films: Sequence[CameraFilm], libraries: Sequence[Library]) -> dict[int, int]:
    """{camera: whose film it seems to have instead}, both ways; a camera each.

    Films of another shape, wide or upright, are not tried in a camera's place.
    """
    pictures = [describe(film.squares) for film in films]
    found: dict[int, int] = {}
    for i, j in combinations(range(len(films)), 2):
        if not _are_of_one_shape(films[i].frames, films[j].frames) or {i, j} & found.keys():
            continue
        alike = np.array(
            [[_motion_alike(pictures[a], libraries[b]) for b in (i, j)] for a in (i, j)]
        )
        own, other = np.diag(alike), np.diag(alike[:, ::-1])
        if (other > own).all() and other.sum() > _MIN_SIMILARITY_RATIO * own.sum():
            found |= {i: j, j: i}
    return found


def _are_of_one_shape(one: np.ndarray, other: np.ndarray) -> bool:
    a, b = (film.shape[3] / film.shape[2] for film in (one, other))
    return max(a, b) <= _MAX_ASPECT_FACTOR * min(a, b)


def _motion_alike(pictures: Features, library: Library) -> float:
    """Mean cosine of what moves in a film's pictures and in the most similar simulated ones."""
    return float(likeness(pictures, library.features)[1].max(1).mean())
