"""The sky of a camera that never turns: drawn once, smoothly."""

import hashlib

import mujoco
import mujoco_warp
import numpy as np
import warp

from simtune.simulation.rendering.packing import packed
from simtune.simulation.rendering.sky import has_sky, sky_alone
from simtune.simulation.rendering.warp_context import draw, make_context
from simtune.simulation.rendering.warp_model import put_model

_SAMPLES = 4  # per pixel and axis: stars are smaller than pixels and would sparkle
_SKIES: dict[tuple, np.ndarray] = {}  # the latest: a run has several simulators of one sky
_MOST_SKIES = 8


def constant_sky(model: mujoco.MjModel, camera: str, size: tuple[int, int]) -> np.ndarray:
    """(H, W) packed pixels behind everything, which are not to be changed."""
    if not has_sky(model):
        return packed(np.zeros((*size, 3), np.uint8))
    alone = sky_alone(model, camera)
    content = np.empty(mujoco.mj_sizeModel(alone), np.uint8)
    mujoco.mj_saveModel(alone, None, content)
    key = hashlib.sha256(content.tobytes()).digest(), size, str(warp.get_device())
    if (sky := _SKIES.get(key)) is None:
        if len(_SKIES) >= _MOST_SKIES:
            _SKIES.clear()
        sky = _SKIES[key] = _draw(alone, size)
    return sky


def _draw(alone: mujoco.MjModel, size: tuple[int, int]) -> np.ndarray:
    data = mujoco.MjData(alone)
    mujoco.mj_forward(alone, data)
    context = make_context(alone, 0, size, render_skybox=True, samples_per_pixel=_SAMPLES)
    draw(put_model(alone), mujoco_warp.put_data(alone, data), context)
    sums = context.aa_accum.numpy().reshape(*size, 3)  # of 255; its pixels are cut off, not rounded
    return packed(np.rint(sums / _SAMPLES**2).astype(np.uint8))
