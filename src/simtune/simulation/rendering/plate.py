"""A plate: a background picture behind the simulator's moving things (as in film-making)."""

import copy

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters import Parameter, ParameterSpace, field_of


def before_plate(model: mujoco.MjModel, space: ParameterSpace) -> mujoco.MjModel:
    """A copy that does not draw static geoms, except those whose colour is a parameter.

    Their contacts stay as they are. One whose size or place alone is a parameter is hidden, too, so
    no picture shows that parameter.
    """
    model, hidden = copy.copy(model), stands_still(model)
    for parameter in space:
        if parameter.is_appearance:
            hidden &= ~geoms_coloured_by(model, parameter)
    model.geom_rgba[hidden] = 0
    return model


def stands_still(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) bool: geoms that never move in the world."""
    return ~can_move(model, model.geom_bodyid)


def can_move(model: mujoco.MjModel, bodies: np.ndarray) -> np.ndarray:
    """Bool for each of the indices `bodies`: whether it has joints, or follows a mocap body."""
    is_placed = model.body_mocapid[model.body_rootid[bodies]] >= 0
    return (model.body_weldid[bodies] != 0) | is_placed


def check_stands_still(model: mujoco.MjModel, camera: str) -> None:
    """Raises InputError for a camera that moves, whose background is no fixed picture."""
    if camera_moves(model, camera):
        raise InputError(
            f"camera {camera!r} moves, and a background is a picture that stands still; say "
            'background = "unknown" if the model lacks what is around, or leave it out'
        )


def camera_moves(model: mujoco.MjModel, camera: str) -> bool:
    """Whether a camera may move with the state."""
    given = model.camera(camera)
    turns = model.cam_mode[given.id] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED.value
    return bool(turns or can_move(model, model.cam_bodyid[given.id]))


def geoms_coloured_by(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """(ngeom,) bool: geoms whose own colour, or whose material's, an appearance parameter is."""
    prefix = field_of(parameter.field).prefix
    if prefix == "geom":
        ids = [model.geom(name).id for name in parameter.objects]
        return np.isin(np.arange(model.ngeom), ids)
    if prefix == "mat":
        return np.isin(model.geom_matid, [model.material(name).id for name in parameter.objects])
    return np.zeros(model.ngeom, bool)
