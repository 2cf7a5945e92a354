"""Skies whose stars are no smaller than pixels: they would sparkle as the camera turns."""

import copy

import mujoco
import numpy as np


def smooth_sky(model: mujoco.MjModel, pixel_deg: float) -> mujoco.MjModel:
    """A copy of the model with its skyboxes averaged over squares of about a pixel's angle."""
    model = copy.copy(model)
    for texture in np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value):
        width, height = model.tex_width[texture], model.tex_height[texture]
        side = round(width * pixel_deg / 90) if height == 6 * width else 0  # six faces of 90°
        if side > 1:
            start = model.tex_adr[texture]
            texels = slice(start, start + height * width * model.tex_nchannel[texture])
            faces = model.tex_data[texels].reshape(6, width, width, -1)
            model.tex_data[texels] = _average(faces, side).ravel()
    return model


def _average(faces: np.ndarray, side: int) -> np.ndarray:
    """(n, W, W, channels) uint8, each square of `side` texels in its mean colour."""
    width = faces.shape[1]
    starts = np.arange(0, width, side)  # the last squares may be smaller
    sizes = np.diff(starts, append=width)
    sums = np.add.reduceat(faces.astype(float), starts, axis=1)
    sums = np.add.reduceat(sums, starts, axis=2)
    means = np.rint(sums / np.outer(sizes, sizes)[..., None]).astype(np.uint8)
    return means.repeat(sizes, axis=1).repeat(sizes, axis=2)
