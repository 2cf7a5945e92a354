"""Noise of pixels: of what a fit leaves, and of rounding to 256 levels."""

import numpy as np

from simtune.fit.pictures.scene import SHOWN
from simtune.normal import MAD_TO_STD

_ROUNDING = 1 / 255 / 12**0.5  # standard deviation


def rounding_std(slope: np.ndarray, drawn: np.ndarray) -> float:
    """Standard deviation of a parameter due to rounding (M, pixels) to 256 levels.

    Pixels of one level are all rounded alike, so many of them tell no more than one. Each level has
    an independent rounding error.
    """
    shown = np.abs(slope) > SHOWN
    if not shown.any():
        return _ROUNDING / SHOWN
    square, level = np.square(slope[shown]), np.round(255 * drawn[shown].clip(0, 1)).astype(int)
    by_level = np.bincount(level, square)
    num_levels = by_level.sum() ** 2 / np.square(by_level).sum()
    return _ROUNDING / np.sqrt(num_levels * square.mean())


def noise_by_pixel(residual: np.ndarray, slopes: np.ndarray, at_least: float) -> np.ndarray:
    """(M, pixels) of `noise_by_parameter`, the largest of the parameters that a pixel shows."""
    shown, noise = np.abs(slopes) > SHOWN, np.full_like(residual, at_least)
    for own, where in zip(noise_by_parameter(residual, shown, at_least), shown, strict=True):
        noise = np.where(where, np.maximum(noise, own), noise)
    return noise


def noise_by_parameter(residual: np.ndarray, shown: np.ndarray, at_least: float) -> np.ndarray:
    """(V,) robust std of residuals (M, pixels), where each parameter shows, (V, M, pixels) bool.

    For each parameter separately: a good fit of the ground says nothing about a thin pole.
    """
    sizes = [np.abs(residual[where]) for where in shown]
    own = [MAD_TO_STD * float(np.median(size)) if len(size) else 0.0 for size in sizes]
    return np.maximum(own, at_least)
