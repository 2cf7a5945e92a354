"""What moves in pictures, and whether it agrees with other pictures at its own moments only.

Symmetric scenes, and other things that move, are as alike at any moment: they tell nothing by this.
"""

import numpy as np

from simtune.checking.film.features import SIZE, describe
from simtune.vision.smoothing import smoothed

_HALF_SIZE = SIZE // 2


def moving(episodes: np.ndarray) -> np.ndarray:
    """(E, K, D) unit vectors, or 0: what moves in (E, K, SIZE, SIZE, 3)."""
    return _units(describe(episodes).moving.reshape(*episodes.shape[:2], -1))


def moving_roughly(episodes: np.ndarray) -> np.ndarray:
    """(E, K, D) the same, blurred: of parts that may be some pixels elsewhere."""
    halves = describe(episodes).moving.reshape(-1, _HALF_SIZE // 2, 2, _HALF_SIZE // 2, 2)
    blurred = smoothed(halves.mean((2, 4))[..., None])
    return _units(blurred.reshape(*episodes.shape[:2], -1))


def agreement(shown: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(E,) of (E, K, D) and (E, K, D): mean cosine at the same moments, less at others."""
    alike = np.einsum("ekd,eld->ekl", shown, drawn)
    same = np.einsum("ekk->e", alike)
    num = shown.shape[1]
    return same / num - (alike.sum((1, 2)) - same) / (num * (num - 1))


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-6)
