"""Skies: for all six faces, and before a camera that turns."""

import copy
from types import SimpleNamespace

import mujoco
import numpy as np
import warp
from mujoco_warp import RenderContext
from mujoco_warp._src.render_util import create_warp_texture, texture_pixels

from simtune.parameters import ParameterSpace, field_of
from simtune.simulation.rendering.plate import can_move


def can_turn(model: mujoco.MjModel, space: ParameterSpace, camera: int) -> bool:
    """Whether the camera's direction may change, by the state or by a parameter."""
    fields = {p.field for p in space} - {"cam_pos"}  # a camera that merely moves sees the same sky
    if any(field_of(f).prefix == "cam" or f == "body_quat" for f in fields):
        return True
    mode = mujoco.mjtCamLight(model.cam_mode[camera])
    if mode != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        keeps_direction = ("mjCAMLIGHT_TRACK", "mjCAMLIGHT_TRACKCOM")
        return mode.name not in keeps_direction
    return bool(can_move(model, model.cam_bodyid[camera]))


def smooth_sky(model: mujoco.MjModel, pixel_deg: float) -> mujoco.MjModel:
    """A copy of the model with its skyboxes averaged over squares of about a pixel's angle.

    Stars smaller than pixels would sparkle as the camera turns.
    """
    model = copy.copy(model)
    for texture in np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value):
        width, height = model.tex_width[texture], model.tex_height[texture]
        side = round(width * pixel_deg / 90)  # a face has 90°
        if side > 1:
            start = model.tex_adr[texture]
            texels = slice(start, start + height * width * model.tex_nchannel[texture])
            faces = model.tex_data[texels].reshape(height // width, width, width, -1)
            model.tex_data[texels] = _average_squares(faces, side).ravel()
    return model


def complete_sky(model: mujoco.MjModel, context: RenderContext) -> None:
    """Give a sky of one image, which is that of all faces, six of them: mujoco_warp expects so."""
    sky = int(context.skybox_tex_id.numpy()[0])
    if sky < 0 or model.tex_height[sky] != model.tex_width[sky]:
        return
    faces = np.tile(texture_pixels(model, sky), (6, 1, 1))
    height, width, num_channels = faces.shape
    stacked = SimpleNamespace(  # what it reads of a model
        tex_adr=[0],
        tex_data=faces.ravel(),
        tex_height=[height],
        tex_width=[width],
        tex_nchannel=[num_channels],
    )
    context.textures_registry[sky] = create_warp_texture(stacked, 0)  # pyright: ignore
    context.textures = warp.array(context.textures_registry, dtype=warp.Texture2D)


def _average_squares(faces: np.ndarray, side: int) -> np.ndarray:
    """(n, W, W, channels) uint8, each square of `side` texels in its mean colour."""
    width = faces.shape[1]
    starts = np.arange(0, width, side)  # the last squares may be smaller
    sizes = np.diff(starts, append=width)
    sums = np.add.reduceat(faces.astype(float), starts, axis=1)
    sums = np.add.reduceat(sums, starts, axis=2)
    means = np.rint(sums / np.outer(sizes, sizes)[..., None]).astype(np.uint8)
    return means.repeat(sizes, axis=1).repeat(sizes, axis=2)
