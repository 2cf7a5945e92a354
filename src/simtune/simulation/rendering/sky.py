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

_SKYBOX = mujoco.mjtTexture.mjTEXTURE_SKYBOX.value


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


def has_sky(model: mujoco.MjModel) -> bool:
    """Whether there is a skybox; without one, what is behind everything is black."""
    return bool((model.tex_type == _SKYBOX).any())


def sky_alone(model: mujoco.MjModel, camera: str) -> mujoco.MjModel:
    """A model of the sky, and of the camera where it is at first; nothing else of it is drawn.

    Warp compiles for what a scene consists of, which takes two seconds: all skies are one scene.
    """
    faces = _faces(model, int(np.flatnonzero(model.tex_type == _SKYBOX)[0]))
    spec = mujoco.MjSpec()
    spec.worldbody.add_camera()
    spec.worldbody.add_geom(size=(1e-3, 0, 0), rgba=(0, 0, 0, 0))  # Warp's tree cannot be empty
    gradient = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    spec.add_texture(name="sky", type=_SKYBOX, builtin=gradient, width=faces.shape[1])
    alone = spec.compile()
    alone.tex_data[:] = faces.ravel()
    data, of = mujoco.MjData(model), model.camera(camera).id
    mujoco.mj_forward(model, data)
    alone.cam_pos[0] = data.cam_xpos[of]
    mujoco.mju_mat2Quat(alone.cam_quat[0], data.cam_xmat[of])
    for name in ("fovy", "intrinsic", "sensorsize", "resolution", "projection"):
        getattr(alone, f"cam_{name}")[0] = getattr(model, f"cam_{name}")[of]
    return alone


def smooth_sky(model: mujoco.MjModel, pixel_deg: float) -> mujoco.MjModel:
    """A copy of the model with its skyboxes averaged over squares of about a pixel's angle.

    Stars smaller than pixels would sparkle as the camera turns.
    """
    model = copy.copy(model)
    for texture in np.flatnonzero(model.tex_type == _SKYBOX):
        texels = texture_pixels(model, int(texture))  # in place
        _, width, channels = texels.shape
        side = round(width * pixel_deg / 90)  # a face has 90°
        if side > 1:
            faces = texels.reshape(-1, width, width, channels)
            faces[:] = _average_squares(faces, side)
    return model


def complete_sky(model: mujoco.MjModel, context: RenderContext) -> None:
    """Give a sky of one image, which is that of all faces, six of them: mujoco_warp expects so."""
    sky = int(context.skybox_tex_id.numpy()[0])
    if sky < 0 or model.tex_height[sky] != model.tex_width[sky]:
        return
    faces = _faces(model, sky)
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


def _faces(model: mujoco.MjModel, sky: int) -> np.ndarray:
    """(6 W, W, 3) uint8: the faces of a sky, of which a file may have one for all."""
    faces = texture_pixels(model, sky)[..., :3]
    faces = faces.repeat(3 // faces.shape[-1], axis=-1)  # grey ones
    return np.tile(faces, (6, 1, 1)) if len(faces) == faces.shape[1] else faces


def _average_squares(faces: np.ndarray, side: int) -> np.ndarray:
    """(n, W, W, channels) uint8, each square of `side` texels in its mean colour."""
    width = faces.shape[1]
    starts = np.arange(0, width, side)  # the last squares may be smaller
    sizes = np.diff(starts, append=width)
    sums = np.add.reduceat(faces.astype(float), starts, axis=1)
    sums = np.add.reduceat(sums, starts, axis=2)
    means = np.rint(sums / np.outer(sizes, sizes)[..., None]).astype(np.uint8)
    return means.repeat(sizes, axis=1).repeat(sizes, axis=2)
