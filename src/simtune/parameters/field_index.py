"""Where in a model's fields parameters are, and what cannot be written there."""

import mujoco
import numpy as np

from simtune.errors import InputError, UnknownName
from simtune.parameters.parameter import Parameter
from simtune.parameters.space import ParameterSpace

# What an object of a field's first word is called in MuJoCo, and where their number is.
_OBJECT_TYPES = {
    "body": (mujoco.mjtObj.mjOBJ_BODY, "nbody"),
    "geom": (mujoco.mjtObj.mjOBJ_GEOM, "ngeom"),
    "jnt": (mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "dof": (mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "site": (mujoco.mjtObj.mjOBJ_SITE, "nsite"),
    "cam": (mujoco.mjtObj.mjOBJ_CAMERA, "ncam"),
    "light": (mujoco.mjtObj.mjOBJ_LIGHT, "nlight"),
    "mat": (mujoco.mjtObj.mjOBJ_MATERIAL, "nmat"),
    "actuator": (mujoco.mjtObj.mjOBJ_ACTUATOR, "nu"),
    "tendon": (mujoco.mjtObj.mjOBJ_TENDON, "ntendon"),
    "eq": (mujoco.mjtObj.mjOBJ_EQUALITY, "neq"),
}


def field_index(
    model: mujoco.MjModel, parameter: Parameter, nominal: dict[str, np.ndarray]
) -> tuple:
    """Where in its field a parameter is: (rows,), (rows, component), or without rows.

    Raises UnknownName for an object that the model lacks, InputError for a component.
    """
    name, field = parameter.name, parameter.field
    component: tuple = () if parameter.component is None else (parameter.component,)
    if field.startswith("opt."):
        if parameter.objects:
            raise InputError(f"{name}: {field} has no objects, got {', '.join(parameter.objects)}")
        place = component or (...,)
    else:
        if field.endswith("_rgba") and not component:
            component = (slice(0, 3),)  # a grey: alpha stays
        place = (_rows(model, parameter), *component)
    try:
        nominal[field][place]
    except IndexError:
        raise InputError(f"{name}: {field} has no component {parameter.component}") from None
    return place


def _rows(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """Rows of the field that the parameter's objects own."""
    word = parameter.field.split("_")[0]
    if word not in _OBJECT_TYPES:
        raise InputError(
            f"{parameter.name}: {parameter.field} cannot be written; "
            f"fields of these can: {', '.join(_OBJECT_TYPES)}, opt"
        )
    if not parameter.objects:
        raise InputError(f"{parameter.name}: {parameter.field} needs the names of its objects")
    return np.concatenate([rows_of(model, parameter.field, name) for name in parameter.objects])


def rows_of(model: mujoco.MjModel, field: str, name: str) -> np.ndarray:
    """Rows of a field that the object `name` owns: one, or as many as a joint has dofs.

    Raises UnknownName for an object that the model lacks.
    """
    word = field.split("_")[0]
    kind, count = _OBJECT_TYPES[word]
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        names = (mujoco.mj_id2name(model, kind, i) for i in range(getattr(model, count)))
        known = [n for n in names if n]  # those without a name cannot be asked for
        raise UnknownName(kind.name[6:].lower(), name, "the model", known)
    return np.flatnonzero(model.dof_jntid == index) if word == "dof" else np.array([index])


def refuse_overlaps(space: ParameterSpace, places: list[tuple], nominal) -> None:
    """Two parameters that write the same number cannot both be found."""
    owner = {field: np.full(values.shape, -1) for field, values in nominal.items()}
    for i, (parameter, place) in enumerate(zip(space, places, strict=True)):
        others = owner[parameter.field][place]
        if (others >= 0).any():
            other = space.parameters[others.max()].name
            raise InputError(f"{other} and {parameter.name} write the same {parameter.field}")
        owner[parameter.field][place] = i


def refuse_forgotten_delays(
    model: mujoco.MjModel, space: ParameterSpace, places: list[tuple]
) -> None:
    """MuJoCo delays by no more than the actuator's history, and says nothing of the rest."""
    for parameter, place in zip(space, places, strict=True):
        if not parameter.is_delay:
            continue
        remembered_s = model.actuator_history[place[0], 0].min() * model.opt.timestep
        if parameter.high > remembered_s * (1 + 1e-6):
            raise InputError(
                f"{parameter.name}: the model remembers controls for {remembered_s:g} s, less "
                f"than the longest delay of {parameter.high:g} s; Task.load_model sees to that"
            )
