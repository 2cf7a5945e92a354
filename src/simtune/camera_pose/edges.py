"""Where edges are and how they run, whatever the colours and the light on both sides of them."""

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

_SLOPE_PX = 1.0  # over which a picture's slope is taken
_FAINT = 0.03  # of the full scale in a pixel: an edge of that contrast counts half
_ALIKE = 0.3  # edges that differ by this count half as much as those that have nothing in common


def edges(pictures: np.ndarray, blur: float) -> np.ndarray:
    """(M, H, W, 3) uint8 to (M, H, W, 2): twice the angle of the slope, as a vector of 0 to 1.

    With a picture's structure tensor J, summed over its colours (Di Zenzo 1986):

        (Jxx − Jyy, 2 Jxy) / (Jxx + Jyy + faint²)

    From dark to bright is the same as from bright to dark. `blur`: pixels by which that is blurred.
    """
    shades = pictures.astype(np.float32) / 255
    down, right = (
        gaussian_filter1d(gaussian_filter1d(shades, _SLOPE_PX, 3 - axis), _SLOPE_PX, axis, order=1)
        for axis in (1, 2)
    )
    xx, yy, xy = (np.sum(product, -1) for product in (right**2, down**2, right * down))
    along = np.stack([xx - yy, 2 * xy], -1) / (xx + yy + _FAINT**2)[..., None]
    return gaussian_filter(along, (0, blur, blur, 0), mode="nearest")


def unlike(difference: np.ndarray) -> np.ndarray:
    """0 to 1 (Geman and McClure 1985): what is not modelled counts no more than it has to."""
    squared = np.square(difference)
    return squared / (squared + _ALIKE**2)


def weight(difference: np.ndarray) -> np.ndarray:
    """By which squares count where `unlike` is to be lowered."""
    return 1 / (1 + np.square(difference / _ALIKE)) ** 2
