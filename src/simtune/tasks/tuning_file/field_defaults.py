"""What is usual for fields of MjModel, so that a tuning file needs few words."""

import difflib
from typing import Literal

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS

from simtune.errors import InputError, UnknownName
from simtune.parameters import Parameter, rows_of
from simtune.parameters.field_index import field_index
from simtune.parameters.model_writer import start_from_material

_SHAPED_BY_ASSETS = (mujoco.mjtGeom.mjGEOM_MESH.value, mujoco.mjtGeom.mjGEOM_HFIELD.value)
# Kinds of parameters in MuJoCo's words: field, component (None: the whole row, or to be said).
KINDS: dict[str, tuple[str, int | None]] = {
    "mass": ("body_mass", None),
    "friction": ("geom_friction", 0),
    "size": ("geom_size", None),
    "damping": ("dof_damping", None),
    "armature": ("dof_armature", None),
    "friction_loss": ("dof_frictionloss", None),
    "stiffness": ("jnt_stiffness", None),
    "tendon_length": ("tendon_range", 1),
    "tendon_damping": ("tendon_damping", None),
    "tendon_stiffness": ("tendon_stiffness", None),
    "gain": ("actuator_gainprm", 0),
    "gear": ("actuator_gear", 0),
    "delay": ("actuator_delay", None),
    "light": ("light_diffuse", None),
    "field_of_view": ("cam_fovy", None),
}

_UNITS = {
    "body_mass": "kg",
    "geom_size": "m",
    "tendon_range": "m",
    "tendon_damping": "N·s/m",
    "tendon_stiffness": "N/m",
    "actuator_delay": "s",
    "cam_fovy": "°",
    "opt.gravity": "m/s²",
    "opt.timestep": "s",
}
_JOINT_UNITS = {  # of what turns, of what slides
    "dof_damping": ("N·m·s/rad", "N·s/m"),
    "dof_armature": ("kg·m²", "kg"),
    "dof_frictionloss": ("N·m", "N"),
    "jnt_stiffness": ("N·m/rad", "N/m"),
}
# How far to search from the nominal value, to either side.
_TURN_RAD, _CAMERA_M, _CAMERA_DEG = 0.1, 0.1, 10.0
_FACTOR = 10.0  # the same on a log scale


def own_values(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """What a model has where the parameter writes, whatever its shape.

    Raises UnknownName for an object, InputError for what cannot be written.
    """
    field, values = parameter.field, _values(model, parameter.field)
    place = field_index(model, parameter, {field: values})
    if parameter.is_colour:
        values = values.copy()
        start_from_material(values, np.unique(place[0]), model, field)
    return values[place]


def check_field(model: mujoco.MjModel, field: str) -> None:
    """Raises InputError for what is no field of real numbers."""
    if field not in MODEL_FIELDS:
        if difflib.get_close_matches(field, MODEL_FIELDS, n=1):
            raise UnknownName("field", field, "MjModel", sorted(MODEL_FIELDS))
        usual = ", ".join(sorted({field for field, _ in KINDS.values()}))
        raise InputError(f"no field {field!r} in MjModel; usual ones are: {usual}")
    if field == "opt.timestep":
        raise InputError(
            "opt.timestep says how finely physics is computed, and a recording knows its own time: "
            "it cannot be tuned"
        )
    if not np.issubdtype(_values(model, field).dtype, np.floating):
        raise InputError(f"{field} holds no real numbers, so it cannot be tuned")


def check_component(model: mujoco.MjModel, parameter: Parameter) -> None:
    """Raises InputError for one that a row of the field has not."""
    field, component = parameter.field, parameter.component
    values = _values(model, field)
    width = values.shape[-1] if values.ndim == 1 + (not field.startswith("opt.")) else 0
    if component is not None and not parameter.is_rotation and component >= width:
        has = f"components 0 to {width - 1}" if width else "no components"
        raise InputError(f"{field} has {has}, got component = {component}")


def check_objects(model: mujoco.MjModel, parameter: Parameter) -> None:
    """Raises InputError for objects that have the field, but none that could be another."""
    rows = (rows_of(model, parameter.field, name) for name in parameter.objects)
    for name, row in zip(parameter.objects, rows, strict=True):
        if parameter.field == "geom_size" and model.geom_type[row].item() in _SHAPED_BY_ASSETS:
            raise InputError(f"{name} has the size of its mesh or height field: scale that")
        if parameter.field == "cam_fovy" and model.cam_sensorsize[row].any():
            raise InputError(
                f"camera {name} has a sensorsize, which its field of view follows: give it fovy"
            )


def _values(model: mujoco.MjModel, field: str) -> np.ndarray:
    """Of a field or an option."""
    is_option = field.startswith("opt.")
    return np.asarray(getattr(model.opt, field[4:]) if is_option else getattr(model, field))


def own_nominal(model: mujoco.MjModel, parameter: Parameter) -> float:
    """The one number that a parameter has in a model: nominal. Raises InputError for several."""
    values = own_values(model, parameter)
    if parameter.is_rotation:
        return 0.0
    if parameter.is_factor:
        if not values.any():
            raise InputError(f"{parameter.field} is 0 there, so a factor changes nothing")
        return 1.0
    if values.size and (values == values.flat[0]).all():
        return float(str(values.flat[0]))  # a single-precision 0.7 is 0.7
    if parameter.is_colour or len(parameter.objects) > 1:
        several = ", ".join(f"{value:.3g}" for value in values.flat[:4])
        raise InputError(f"{parameter.field} is not one number there ({several}): say nominal")
    raise InputError(
        f"{parameter.field} has {values.size} numbers: say which by component, "
        f"0 to {values.size - 1}"
    )


def usual_range(
    parameter: Parameter, nominal: float
) -> tuple[float | None, float | None, Literal["log", "linear"]]:
    """Low and high, None where there is nothing usual, and the scale."""
    if parameter.is_colour:
        return 0.0, 1.0, "linear"
    if parameter.is_delay:
        return 0.0, None, "linear"
    if parameter.is_rotation:
        return nominal - _TURN_RAD, nominal + _TURN_RAD, "linear"
    if parameter.field == "cam_pos":
        return nominal - _CAMERA_M, nominal + _CAMERA_M, "linear"
    if parameter.field == "cam_fovy":
        return max(1.0, nominal - _CAMERA_DEG), min(170.0, nominal + _CAMERA_DEG), "linear"
    if nominal > 0 and not parameter.field.endswith("_pos"):
        return nominal / _FACTOR, nominal * _FACTOR, "log"
    return None, None, "linear"


def usual_unit(model: mujoco.MjModel, parameter: Parameter) -> str:
    field = parameter.field
    if parameter.is_factor:
        return "×"
    if parameter.is_rotation:
        return "rad"
    if field in _JOINT_UNITS:
        kind = model.joint(parameter.objects[0]).type[0]
        return _JOINT_UNITS[field][int(kind == mujoco.mjtJoint.mjJNT_SLIDE.value)]
    return "m" if field.endswith("_pos") else _UNITS.get(field, "1")
