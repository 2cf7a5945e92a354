"""The pictures of a lens, as a pinhole would see them."""

import functools
import math

import numpy as np
from scipy.sparse import csr_array

from simtune.cameras.lens import Lens
from simtune.errors import InputError

SHAPE = 0.01  # of width over height, by which a lens's pictures may differ from its calibration
_FEWEST_POINTS, _POINTS_PER_PIXEL = 2, 2  # per new pixel; per old one, along an axis


def rectify(picture: np.ndarray, lens: Lens, size: tuple[int, int]) -> np.ndarray:
    """(H, W, 3) uint8 of a lens to (height, width, 3) of its pinhole, by area averaging.

    Raises InputError for pictures of another shape than those of the calibration.
    """
    height, width = picture.shape[:2]
    if abs(width / height - lens.width / lens.height) > SHAPE:
        raise InputError(
            f"pictures of {width}×{height} pixels, the lens was calibrated with "
            f"{lens.width}×{lens.height}; give the calibration of these pictures"
        )
    seen = _areas(lens, height, width, size) @ picture.reshape(-1, 3).astype(np.float32)
    return np.rint(seen).astype(np.uint8).reshape(*size, 3)


@functools.lru_cache(8)
def _areas(lens: Lens, height: int, width: int, size: tuple[int, int]) -> csr_array:
    """(new pixels, old pixels) share of each old pixel in each new one."""
    rows, columns = size
    scale = np.array([width / lens.width, height / lens.height])  # of the calibration's pictures
    times = max(_FEWEST_POINTS, math.ceil(_POINTS_PER_PIXEL * height / rows))
    _, half = lens.half_sides
    at_x, at_y = (
        ((np.arange(n * times) + 0.5) * 2 / times - n) * half / rows for n in (columns, rows)
    )
    seen = lens.seen_px(np.stack(np.meshgrid(at_x, at_y), -1))
    column, row = np.moveaxis(seen * scale - 0.5, -1, 0)
    column, row = np.rint(column).clip(0, width - 1), np.rint(row).clip(0, height - 1)
    old = (row * width + column).astype(int).ravel()
    new_row, new_column = (np.arange(n * times) // times for n in (rows, columns))
    new = (new_row[:, None] * columns + new_column).ravel()
    shares = np.full(len(old), times**-2, np.float32)
    return csr_array((shares, (new, old)), shape=(rows * columns, height * width))
