"""A plate: a picture of what stands still, behind the simulator's things (as in film-making)."""

import copy

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters import ParameterSpace, field_of


def before_plate(model: mujoco.MjModel, space: ParameterSpace) -> mujoco.MjModel:
    """A copy in which what stands still is not drawn, but for what a parameter paints.

    It is there as before for all that touches it.
    """
    model = copy.copy(model)
    still = model.body_weldid[model.geom_bodyid] == 0
    still &= model.body_mocapid[model.body_rootid[model.geom_bodyid]] < 0
    model.geom_rgba[still & ~_painted(model, space)] = 0
    return model


def check_stands_still(model: mujoco.MjModel, camera: str) -> None:
    """Raises InputError for a camera before which no picture stays in its place."""
    its = model.camera(camera)
    body = int(model.cam_bodyid[its.id])
    moves = model.body_weldid[body] != 0 or model.body_mocapid[model.body_rootid[body]] >= 0
    if moves or model.cam_mode[its.id] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value:
        raise InputError(
            f"camera {camera!r} moves, and a background is a picture that stands still; leave "
            "background out, or name a camera that does not move"
        )


def _painted(model: mujoco.MjModel, space: ParameterSpace) -> np.ndarray:
    """(ngeom,) bool: whether its own colour, or that of its material, is a parameter."""
    painted = np.zeros(model.ngeom, bool)
    for parameter in space:
        if not parameter.is_appearance:
            continue
        prefix = field_of(parameter.field).prefix
        if prefix == "geom":
            painted[[model.geom(name).id for name in parameter.objects]] = True
        elif prefix == "mat":
            materials = [model.material(name).id for name in parameter.objects]
            painted |= np.isin(model.geom_matid, materials)
    return painted
