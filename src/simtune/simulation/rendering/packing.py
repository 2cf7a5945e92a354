# type: ignore
# ruff: noqa: RUF046, UP018
# The kernel is in Warp's language, not Python.
"""Pixels as mujoco_warp packs them, ARGB in 32 bits, and as pictures, (H, W, 3) uint8 RGB."""

import numpy as np
import warp as wp

NOTHING = wp.constant(wp.uint32(0))  # of a ray without a hit; drawn pixels are opaque, so never 0

wp.set_module_options({"enable_backward": False})


def packed(picture: np.ndarray) -> np.ndarray:
    """(..., 3) uint8 RGB to (...,) uint32."""
    opaque = np.full((*picture.shape[:-1], 1), 255, np.uint8)
    return np.concatenate([picture[..., ::-1], opaque], -1).view(np.uint32)[..., 0]


@wp.kernel
def unpack(
    pixels: wp.array2d[wp.uint32],
    behind: wp.array2d[wp.uint32],
    run: int,
    rgb: wp.array3d[wp.uint8],
):
    """(n, H · W) pixels, before others if there are any, (n or 1 or 0, H · W), to (n, H · W, 3).

    In runs of successive ones, like `primitives.kernel.draw`.
    """
    world, part = wp.tid()
    first = part * run
    other = int(-1)
    if behind.shape[0] > 0:
        other = world % behind.shape[0]
    for at in range(first, first + run):
        pixel = pixels[world, at]
        if other >= 0 and pixel == NOTHING:
            pixel = behind[other, at]
        rgb[world, at, 0] = wp.uint8(pixel >> wp.uint32(16))
        rgb[world, at, 1] = wp.uint8(pixel >> wp.uint32(8))
        rgb[world, at, 2] = wp.uint8(pixel)
