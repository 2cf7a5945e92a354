"""What OpenGL makes of a model's textures, materials, flexes and lamps, written into a copy.

mujoco_warp, from whose fields the ray caster draws, takes the model at its word.
"""

import copy

import mujoco
import numpy as np

from simtune.parameters.model_writer import DEFAULT_GREY

_LEAST_SHININESS = 1e-5
_MAX_CUTOFF_DEG = 90.0
_MAX_SPOT_EXPONENT = 128.0
_LIGHTS = mujoco.mjtLightType
_SPOT, _DIRECTIONAL = _LIGHTS.mjLIGHT_SPOT.value, _LIGHTS.mjLIGHT_DIRECTIONAL.value
_POINT, _IMAGE = _LIGHTS.mjLIGHT_POINT.value, _LIGHTS.mjLIGHT_IMAGE.value
NUM_GROUPS = 3  # of geoms that are seen, the first ones; the others are for contacts
_MOST_LAMPS = 8  # at once, with the headlight
# OpenGL "ignores unsupported light types", says MuJoCo's source; they count as lamps nevertheless
_UNSUPPORTED_LIGHTS = (_POINT, _IMAGE)
_NO_LAMPS_AMBIENT = 0.3
_SRGB, _LINEAR = mujoco.mjtColorSpace.mjCOLORSPACE_SRGB, mujoco.mjtColorSpace.mjCOLORSPACE_LINEAR


def as_opengl_reads(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy whose fields say what OpenGL draws."""
    by_reference = (model.tex_adr < 0).any()
    model = mujoco.mj_embedAssets(model) if by_reference else copy.copy(model)  # type: ignore
    _drop_textures(model)
    _decode(model)
    _paint_flexes(model)
    _choose_lamps(model)
    model.mat_shininess[:] = most_matt(model.mat_shininess)
    model.light_exponent[:] = focus(model.light_exponent)
    model.light_type[:] = kinds_of_lamps(model.light_type, model.light_cutoff)
    return model


def most_matt(shininess: np.ndarray) -> np.ndarray:
    """Shininess that mujoco_warp draws as OpenGL does, where 0 is an even gloss, not none."""
    return np.maximum(shininess, _LEAST_SHININESS)


def focus(exponent: np.ndarray) -> np.ndarray:
    """Spotlights' exponents as OpenGL takes them: it refuses some, and then its own stays, 0."""
    return np.where((exponent < 0) | (exponent > _MAX_SPOT_EXPONENT), 0, exponent)


def kinds_of_lamps(kinds: np.ndarray, cutoff: np.ndarray) -> np.ndarray:
    """Kinds as mujoco_warp draws what OpenGL makes of spotlights with these angles, degrees.

    OpenGL refuses those beyond 90°; by its own, a lamp shines everywhere, evenly.
    """
    return np.where(
        kinds == _DIRECTIONAL, kinds, np.where(cutoff > _MAX_CUTOFF_DEG, _POINT, _SPOT)
    ).astype(np.int32)


def _drop_textures(model: mujoco.MjModel) -> None:
    """Of one or two channels, which OpenGL does not load: materials have their plain colours."""
    is_loaded = np.isin(model.tex_nchannel, (3, 4))
    model.mat_texid[np.isin(model.mat_texid, np.flatnonzero(~is_loaded))] = -1


def _decode(model: mujoco.MjModel) -> None:
    """Make sRGB textures linear; OpenGL takes skies and cubes as they are."""
    encoded = np.arange(256) / 255
    light = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    table = np.rint(255 * light).astype(np.uint8)
    is_flat = model.tex_type == mujoco.mjtTexture.mjTEXTURE_2D.value
    for texture in np.flatnonzero(is_flat & (model.tex_colorspace == _SRGB.value)):
        texels = _texels(model, int(texture))
        texels[:] = table[texels]
        model.tex_colorspace[texture] = _LINEAR.value


def _texels(model: mujoco.MjModel, texture: int) -> np.ndarray:
    """(num, channels) RGB, or grey, in place."""
    channels = int(model.tex_nchannel[texture])
    num = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
    start = model.tex_adr[texture]
    return model.tex_data[start : start + num].reshape(-1, channels)[:, :3]


def _paint_flexes(model: mujoco.MjModel) -> None:
    """With their materials' mean colours, and those of hidden groups not at all."""
    is_plain = (model.flex_rgba == DEFAULT_GREY).all(-1) & (model.flex_matid >= 0)
    model.flex_rgba[is_plain] = model.mat_rgba[model.flex_matid[is_plain]]
    has_faces = model.flex_dim > 1
    for flex in np.flatnonzero((model.flex_matid >= 0) & has_faces):
        texture = model.mat_texid[model.flex_matid[flex], mujoco.mjtTextureRole.mjTEXROLE_RGB.value]
        if texture >= 0:
            model.flex_rgba[flex, :3] *= _texels(model, texture).mean(0) / 255
    model.flex_rgba[model.flex_group >= NUM_GROUPS, 3] = 0


def _choose_lamps(model: mujoco.MjModel) -> None:
    """The first ones, or some light from everywhere if there is no lamp."""
    headlight, lamps = model.vis.headlight, np.flatnonzero(model.light_active)
    model.light_active[lamps[_MOST_LAMPS - bool(headlight.active) :]] = 0
    model.light_active[np.isin(model.light_type, _UNSUPPORTED_LIGHTS)] = 0
    if not headlight.active and not model.light_active.any():
        headlight.active, headlight.ambient = 1, np.full(3, _NO_LAMPS_AMBIENT)
        headlight.diffuse = headlight.specular = np.zeros(3)
