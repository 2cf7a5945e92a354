"""Parts that a background of the recordings shows, too, because they rest most of the time."""

from collections.abc import Sequence

import numpy as np

from simtune.before_after.moving_parts import part_name
from simtune.cameras.views import parts
from simtune.checking.extents import corners_px
from simtune.checking.film.features import SIZE, describe, squeezed
from simtune.checking.film.library import Library
from simtune.simulation import Simulator

_AT_REST_PX = 2.0  # of SIZE: all corners of a part are so near to where they usually are
_MIN_PICTURES_SHARE = 0.5
_MIN_EDGE_COSINE = 0.7  # between the background and the resting part
_WORLDS, _PICTURES = 16, 12  # of a library that are looked at
_BLOCK_PX = 2


def resting_parts(simulator: Simulator, library: Library, view: int) -> list[str]:
    """Names of moving bodies that rest in most of a library's pictures, and that the plate of
    the simulator's view of this index shows where they rest.
    """
    plate = simulator.views[view].plate
    if plate is None:
        return []
    worlds, pictures = (
        np.linspace(0, length - 1, num).astype(int)
        for length, num in zip(library.states.shape, (_WORLDS, _PICTURES), strict=False)
    )
    states, frames = (
        array[worlds][:, pictures].reshape(-1, *array.shape[2:])
        for array in (library.states, library.frames)
    )
    still = squeezed(plate)
    found = []
    for name, corners in _corners_px(simulator, states, view).items():
        away = np.abs(corners - np.median(corners, 0)).max((1, 2))
        if (away < _AT_REST_PX).mean() <= _MIN_PICTURES_SHARE:
            continue
        nearest = int(away.argmin())
        if _edges_agree(still, frames[nearest], corners[nearest]) > _MIN_EDGE_COSINE:
            found.append(name)
    return found


def in_words(names: Sequence[str]) -> str:
    """A warning of `resting_parts`, at least one."""
    one = len(names) == 1
    rest, it, moves, them = (
        ("rests", "it", "moves", "it") if one else ("rest", "they", "move", "them")
    )
    return (
        f"the background shows what moves: {', '.join(names)}, which {rest} in most frames; when "
        f"{it} {moves}, the simulator shows {them} twice: give a picture of the scene without "
        f"{them} as background, or record episodes in which {it} {rest} less"
    )


def _corners_px(simulator: Simulator, states: np.ndarray, view: int) -> dict[str, np.ndarray]:
    """{body: (n, L, 2)} pixels, of SIZE, of the corners of its geoms in a view, for (n, S)."""
    columns = parts(simulator.widths)[view]
    scale = SIZE / np.array([columns.stop - columns.start, simulator.image_size])
    found = corners_px(simulator, states, simulator.views)
    return {
        part_name(simulator.model, body): (pixels - [columns.start, 0]) * scale
        for (body, its_view), pixels in found.items()
        if its_view == view
    }


def _edges_agree(still: np.ndarray, frame: np.ndarray, corners: np.ndarray) -> float:
    """Cosine of the edges of two pictures in the box of the corners (L, 2); 0 without any."""
    low = np.floor(corners.min(0) / _BLOCK_PX).astype(int).clip(0)
    high = np.ceil(corners.max(0) / _BLOCK_PX).astype(int).clip(-1) + 1
    half = SIZE // _BLOCK_PX
    edges = describe(np.stack([still, frame])[:, None]).edges.reshape(2, half, half, 2)
    one, other = edges[:, low[1] : high[1], low[0] : high[0]].reshape(2, -1)
    return float(one @ other / max(np.linalg.norm(one) * np.linalg.norm(other), 1e-6))
