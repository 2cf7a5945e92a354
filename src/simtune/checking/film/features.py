"""Picture features that can be compared across colours, light and moments.

They are the direction of edges, whatever is on either side (doubled angles of the structure tensor,
as in Bigün and Granlund, 1987), and the pixels that differ from the static background. Of what
moves, it counts whether pictures agree at their own moments more than at others: symmetric scenes,
and other things that move, are as alike at any moment.
"""

from dataclasses import dataclass

import numpy as np
import torch

from simtune.cameras.pictures import resize
from simtune.vision.smoothing import smoothed

SIZE = 64  # side of the pictures compared, in pixels
_EDGE_LEVELS = 6.0  # of 256 per pixel: steeper slopes all count as edges
_MOVING_LEVELS = 20.0  # of 256: larger differences from the background all count as moving
_NOISE_FACTOR = 3  # on the median difference: less is camera noise


@dataclass(frozen=True)
class Features:
    """Of n pictures; 0 where nothing was seen."""

    edges: np.ndarray  # (n, D) float32
    moving: np.ndarray  # (n, D / 2) float32, from 0 to 1
    seen: np.ndarray  # (D / 2,) float32, 1 where the pictures show something


def squeezed(frames: np.ndarray) -> np.ndarray:
    """(..., H, W, 3) frames as squares of SIZE pixels."""
    each = [resize(frame, (SIZE, SIZE)) for frame in frames.reshape(-1, *frames.shape[-3:])]
    return np.stack(each).reshape(*frames.shape[:-3], SIZE, SIZE, 3)


def describe(episodes: np.ndarray, seen: np.ndarray | None = None) -> Features:
    """Of (E, K, SIZE, SIZE, 3) pictures, n = E · K; `seen`, (SIZE, SIZE) bool, by default all."""
    if seen is None:
        seen = np.ones(episodes.shape[2:4], bool)
    edges, moving = [], []
    for pictures in episodes:  # one by one, to stay in the cache
        smooth = smoothed(pictures.astype(np.float32))
        edges.append(_edges(smooth))
        moving.append(_moving(smooth, seen))
    whole = _seen_blocks(seen)
    return Features(
        _flat(edges) * np.repeat(whole, 2), _flat(moving) * whole, whole.astype(np.float32)
    )


def likeness(pictures: Features, library: Features) -> np.ndarray:
    """(2, n, m) cosines of edges, and of motion, where the n `pictures` show something."""
    return np.stack(
        [
            _cosines(pictures.edges, library.edges, np.repeat(pictures.seen, 2)),
            _cosines(pictures.moving, library.moving, pictures.seen),
        ]
    )


def outlines(picture: np.ndarray) -> np.ndarray:
    """(H, W) from 0 to 1, where a picture (H, W, 3) has edges."""
    tensor = _tensor(smoothed(picture[None].astype(np.float32)))
    return (tensor[2] / (tensor[2] + _EDGE_LEVELS**2))[0]


def moving_share(episodes: np.ndarray) -> np.ndarray:
    """(E,) mean share of pixels that moving things cover, over K pictures."""
    everywhere = np.ones(episodes.shape[2:4], bool)
    smooth = (smoothed(pictures.astype(np.float32)) for pictures in episodes)
    return np.array([_moving(pictures, everywhere).mean() for pictures in smooth])


def moving(episodes: np.ndarray) -> np.ndarray:
    """(E, K, D) unit vectors, or 0: what moves in (E, K, SIZE, SIZE, 3)."""
    return _units(describe(episodes).moving.reshape(*episodes.shape[:2], -1))


def moving_roughly(episodes: np.ndarray) -> np.ndarray:
    """(E, K, D) the same, blurred: of parts that may be some pixels elsewhere."""
    halves = describe(episodes).moving.reshape(-1, SIZE // 4, 2, SIZE // 4, 2)
    blurred = smoothed(halves.mean((2, 4))[..., None])
    return _units(blurred.reshape(*episodes.shape[:2], -1))


def agreement(shown: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(E,) of (E, K, D) and (E, K, D): mean cosine at the same moments, less at others."""
    alike = np.einsum("ekd,eld->ekl", shown, drawn)
    same = np.einsum("ekk->e", alike)
    num = shown.shape[1]
    return same / num - (alike.sum((1, 2)) - same) / (num * (num - 1))


def _edges(smooth: np.ndarray) -> np.ndarray:
    """(K, SIZE / 2, SIZE / 2, 2) edge directions: cosine and sine of twice their angle."""
    across, diagonal, strength = _tensor(smooth)
    weight = 1 / (strength + _EDGE_LEVELS**2)
    return _halved(smoothed(np.stack([across * weight, diagonal * weight], -1)))


def _tensor(smooth: np.ndarray) -> np.ndarray:
    """(3, K, H, W) xx − yy, 2xy and xx + yy of slopes along x and y, summed over the colours."""
    x, y = np.zeros_like(smooth), np.zeros_like(smooth)
    x[:, 1:-1, 1:-1] = (smooth[:, 1:-1, 2:] - smooth[:, 1:-1, :-2]) / 2
    y[:, 1:-1, 1:-1] = (smooth[:, 2:, 1:-1] - smooth[:, :-2, 1:-1]) / 2
    xx, yy, xy = (np.einsum("...c,...c", a, b) for a, b in ((x, x), (y, y), (x, y)))
    return np.stack([xx - yy, 2 * xy, xx + yy])


def _moving(smooth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(K, SIZE / 2, SIZE / 2, 1) difference of pixels from their median over K pictures."""
    change = smooth - np.median(smooth, 0)
    change = np.einsum("...c,...c", change, change)
    change = np.maximum(change - _NOISE_FACTOR * np.median(change[:, seen]), 0)
    return _halved(smoothed((change / (change + _MOVING_LEVELS**2))[..., None]))


def _halved(pictures: np.ndarray) -> np.ndarray:
    """(K, H, W, C) to (K, H / 2, W / 2, C), by the means of blocks."""
    rows = pictures[:, ::2] + pictures[:, 1::2]
    return (rows[:, :, ::2] + rows[:, :, 1::2]) / 4


def _seen_blocks(seen: np.ndarray) -> np.ndarray:
    """(SIZE² / 4,) bool: blocks seen with all neighbouring pixels, so without false edges."""
    all_seen = np.pad(seen, 2, mode="edge")
    for axis in (0, 1):
        rows = np.moveaxis(all_seen, axis, 0)
        near = [rows[i : len(rows) - 4 + i] for i in range(5)]
        all_seen = np.moveaxis(np.logical_and.reduce(near), 0, axis)
    return _halved(all_seen[None, ..., None].astype(float)).ravel() == 1


def _flat(parts: list[np.ndarray]) -> np.ndarray:
    pictures = np.concatenate(parts)
    return pictures.reshape(len(pictures), -1).astype(np.float32)


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-6)


def _cosines(one: np.ndarray, other: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(n, m) cosines of (n, D) and (m, D) vectors, where `seen` (D,); 0 for zero vectors."""
    # NumPy's threads would spin while waiting for each other; torch's sleep.
    a, b, weight = (torch.from_numpy(array) for array in (one, other, seen))
    lengths = torch.sqrt(torch.outer((a**2).sum(1), b**2 @ weight))
    return (a @ b.T / lengths.clamp(min=1e-6)).numpy()
