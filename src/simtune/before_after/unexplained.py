"""Parts of a film that no setting of the simulator explains: a hand, a cable, a thing it lacks."""

import numpy as np
from scipy.ndimage import binary_dilation, binary_opening

from simtune.normal import MAD_TO_STD

_MIN_DIFFERENCE_STDS = 4.0  # of noise
_MIN_DIFFERENCE = 0.06  # of the full scale
_OPENING = np.ones((1, 3, 3), bool)  # what is smaller is an edge that lies a little aside
_GREY_DIMMING, _MARK_RGB = 0.5, np.array([255, 120, 0])


def unexplained(real: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """(T, H, W) bool: where films (T, H, W, 3) uint8 differ by much more than they usually do.

    Exposure may differ from picture to picture. Single lines of pixels do not count.
    """
    difference = (real.astype(np.float32) - simulated) / 255
    difference -= np.median(difference, (1, 2), keepdims=True)
    size = np.abs(difference).max(-1)
    limit = max(_MIN_DIFFERENCE_STDS * MAD_TO_STD * float(np.median(size)), _MIN_DIFFERENCE)
    return binary_dilation(binary_opening(size > limit, _OPENING), _OPENING)


def marked(real: np.ndarray, where: np.ndarray) -> np.ndarray:
    """The film (T, H, W, 3) in dark grey, and orange `where`, (T, H, W) bool."""
    grey = np.repeat(_GREY_DIMMING * real.mean(-1, keepdims=True), 3, -1)
    return np.where(where[..., None], (grey + _MARK_RGB) / 1.5, grey).clip(0, 255).astype(np.uint8)
