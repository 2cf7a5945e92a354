"""A plate: a background picture behind the simulator's moving things (as in film-making)."""

import copy

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters import ParameterSpace, field_of


def before_plate(model: mujoco.MjModel, space: ParameterSpace) -> mujoco.MjModel:
    """A copy that does not draw static geoms, except those whose colour is a parameter.

    Their contacts stay as they are.
    """
    model = copy.copy(model)
    still = model.body_weldid[model.geom_bodyid] == 0
    still &= model.body_mocapid[model.body_rootid[model.geom_bodyid]] < 0
    model.geom_rgba[still & ~_painted(model, space)] = 0
    return model


def check_stands_still(model: mujoco.MjModel, camera: str) -> None:
    """Raises InputError for a camera that moves, whose background is no fixed picture."""
    given = model.camera(camera)
    body = int(model.cam_bodyid[given.id])
    moves = model.body_weldid[body] != 0 or model.body_mocapid[model.body_rootid[body]] >= 0
    if moves or model.cam_mode[given.id] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value:
        raise InputError(
            f"camera {camera!r} moves, and a background is a picture that stands still; leave "
            "background out, or name a camera that does not move"
        )


def _painted(model: mujoco.MjModel, space: ParameterSpace) -> np.ndarray:
    """(ngeom,) bool: whether a geom's own colour, or its material's, is a parameter."""
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
