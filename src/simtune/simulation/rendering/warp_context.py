"""MuJoCo Warp's render contexts: how they are made, and how they draw."""

import os
from collections.abc import Collection
from typing import Any

import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco_warp import Data, Model, RenderContext

from simtune.simulation.rendering.sky import complete_sky


def init_warp(device: str = "cpu") -> None:
    """Start Warp without its output (its greeting, and that there is no CUDA), for a device."""
    warp.config.log_level = warp.LOG_WARNING
    stderr = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)  # below Python, since the library itself prints
    try:
        warp.init()
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
    warp.set_device(device)


def make_context(
    model: mujoco.MjModel,
    camera: str | int,
    size: tuple[int, int],
    tuned: Collection[str] = (),
    **settings: Any,
) -> RenderContext:
    """For pictures of `size`, (height, width); `tuned`: fields that worlds differ in.

    `settings`: further ones of mujoco_warp's.
    """
    context = mujoco_warp.create_render_context(
        model,
        cam_res=(size[1], size[0]),
        cam_active=[model.camera(camera).id],
        render_rgb=True,
        render_depth=False,
        render_seg=False,
        background_color=(0.0, 0.0, 0.0, 0.0),  # packs to packing.NOTHING
        **settings,
    )
    if "light_attenuation" in tuned:  # else compiled for the model's own
        context.light_attenuation_is_default = False
    if "light_cutoff" in tuned:
        context.has_spot_lights = True
    complete_sky(model, context)
    return context


def draw(model: Model, data: Data, context: RenderContext) -> warp.array:
    """(nworld, H · W) packed pixels."""
    mujoco_warp.refit_bvh(model, data, context)
    mujoco_warp.render(model, data, context)
    return context.rgb_data


def assign(target: warp.array, values: np.ndarray) -> None:
    """Values of n worlds to the first n of Warp's own."""
    if values.size:
        shape = (len(values), *target.shape[1:], *target.dtype._shape_)
        values = np.ascontiguousarray(values, np.float32).reshape(shape)
        target[: len(values)].assign(values)
