"""Random pictures behind moving things, for an unknown background.

A camera on a wrist sees a table full of things from ever-changing sides, and no plate shows them. A
detector that learns before such pictures looks at the things that the simulator does draw.
"""

from functools import lru_cache

import numpy as np
import torch
from torch.nn.functional import interpolate

_NUM_TEXTURES = 24  # that pictures are cut out of
_TEXTURE_SCALE = 2  # of a texture's size to a picture's
_OCTAVES = 7
_FLAT_SHARE = 0.15  # of pictures that one colour fills, such as an empty table
_TINT_STD = 60.0  # of 256 levels
_MAX_EDGES = 3  # straight ones, with another texture beyond each


class Backdrops:
    """Pictures of (height, width); the same number gives the same picture."""

    def __init__(self, size: tuple[int, int]):
        self._size = size
        self._textures = _textures((_TEXTURE_SCALE * size[0], _TEXTURE_SCALE * size[1]))

    def of(self, numbers: np.ndarray) -> np.ndarray:
        """(n, H, W, 3) uint8 of (n,) whole numbers."""
        return np.stack([self._draw(np.random.default_rng(number)) for number in numbers])

    def _draw(self, rng: np.random.Generator) -> np.ndarray:
        picture = self._part(rng)
        rows, columns = (np.linspace(-1, 1, n) for n in self._size)
        for _ in range(rng.integers(_MAX_EDGES + 1)):
            angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(-0.8, 0.8)
            beyond = np.cos(angle) * columns + np.sin(angle) * rows[:, None] > away
            np.copyto(picture, self._part(rng), where=beyond[..., None])
        return picture

    def _part(self, rng: np.random.Generator) -> np.ndarray:
        """(H, W, 3) cut out of a texture, in other colours; or a single colour."""
        if rng.random() < _FLAT_SHARE:
            return np.full((*self._size, 3), rng.integers(256, size=3), np.uint8)
        top, left = (rng.integers((_TEXTURE_SCALE - 1) * n + 1) for n in self._size)
        texture = self._textures[rng.integers(_NUM_TEXTURES)]
        part = texture[top : top + self._size[0], left : left + self._size[1]]
        part = part[:: rng.choice([-1, 1]), :: rng.choice([-1, 1]), rng.permutation(3)]
        ends = rng.uniform(0, 255, (2, 1)) + rng.normal(0, _TINT_STD, (2, 3))
        first, last = ends.clip(0, 255)
        levels = np.linspace(first, last, 256).astype(np.uint8)  # (256, 3)
        return np.stack([levels[part[..., c], c] for c in range(3)], -1)


@lru_cache(maxsize=4)  # each takes half a second, and a run has several renderers
def _textures(size: tuple[int, int]) -> np.ndarray:
    """(_NUM_TEXTURES, H, W, 3) uint8, which are not to be changed."""
    rng = np.random.default_rng(0)
    return np.stack([_texture(size, rng) for _ in range(_NUM_TEXTURES)])


def _texture(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8 over the full scale: noise of all scales, as natural pictures have."""
    picture, roughness = np.zeros((*size, 3)), rng.uniform(0.5, 1.0)
    for octave in range(_OCTAVES):
        cells = 2 + 2**octave, 2 + 2**octave, 3
        grid = rng.standard_normal(cells) + 1.5 * rng.standard_normal((*cells[:2], 1))
        way = "bilinear" if rng.integers(2) else "nearest-exact"
        planes = torch.from_numpy(grid).permute(2, 0, 1)[None]
        enlarged = interpolate(planes, size, mode=way)[0].permute(1, 2, 0).numpy()
        picture = picture + roughness**octave * enlarged
    low, high = np.quantile(picture, [0.02, 0.98])
    return np.rint(255 * ((picture - low) / (high - low)).clip(0, 1)).astype(np.uint8)
