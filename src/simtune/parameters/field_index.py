"""Indices of parameters within a model's fields, and checks that they can be written there."""

import mujoco
import numpy as np

from simtune.errors import InputError, UnknownName
from simtune.parameters.field import OBJECT_TYPES
from simtune.parameters.fields import field_of
from simtune.parameters.parameter import Parameter
from simtune.parameters.space import ParameterSpace


def field_index(
    model: mujoco.MjModel, parameter: Parameter, nominal: dict[str, np.ndarray]
) -> tuple:
    """Index of a parameter in its field: (rows,) or (rows, component); options have no rows.

    Raises UnknownName for an object that the model lacks, InputError for a component that the field
    lacks.
    """
    name, field = parameter.name, parameter.field
    component: tuple = () if parameter.component is None else (parameter.component,)
    if parameter.field_info.is_option:
        if parameter.objects:
            raise InputError(f"{name}: {field} has no objects, got {', '.join(parameter.objects)}")
        index = component or (...,)
    else:
        if parameter.field_info.has_alpha and not component:
            component = (slice(0, 3),)  # one value for r, g and b; alpha stays
        index = (_rows(model, parameter), *component)
    try:
        nominal[field][index]
    except IndexError:
        raise InputError(f"{name}: {field} has no component {parameter.component}") from None
    return index


def _rows(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """Rows of the field that the parameter's objects own."""
    if not parameter.field_info.object_type:
        raise InputError(
            f"{parameter.name}: {parameter.field} cannot be written; "
            f"fields of these can: {', '.join(OBJECT_TYPES)}, opt"
        )
    if not parameter.objects:
        raise InputError(f"{parameter.name}: {parameter.field} needs the names of its objects")
    return np.concatenate([rows_of(model, parameter.field, name) for name in parameter.objects])


def rows_of(model: mujoco.MjModel, field: str, name: str) -> np.ndarray:
    """Rows of a field that the object `name` owns: one; for dof fields, one per dof of the joint.

    Raises UnknownName for an object that the model lacks, InputError for a field of controls or
    outputs in a model whose actuators have not one each.
    """
    prefix = field_of(field).prefix
    owner = OBJECT_TYPES[prefix]
    index = mujoco.mj_name2id(model, owner.mjt, name)
    if index < 0:
        count = getattr(model, owner.count)
        names = (mujoco.mj_id2name(model, owner.mjt, i) for i in range(count))
        known = [n for n in names if n]  # unnamed objects cannot be declared
        raise UnknownName(owner.name, name, "the model", known)
    if prefix == "actuator" and len(field_of(field).read(model)) != model.nactuator:
        raise InputError(
            f"{field} cannot be tuned in this model, in which an actuator has several controls or "
            "outputs, or none: take that one out of the model, or tune another field"
        )
    if prefix in ("qpos0", "qpos"):
        return np.array([model.jnt_qposadr[index]])
    return np.flatnonzero(model.dof_jntid == index) if prefix == "dof" else np.array([index])


def refuse_overlaps(space: ParameterSpace, indices: list[tuple], nominal) -> None:
    """Raise InputError if two parameters write the same number: neither could be identified."""
    owner = {field: np.full(values.shape, -1) for field, values in nominal.items()}
    for i, (parameter, index) in enumerate(zip(space, indices, strict=True)):
        others = owner[parameter.field][index]
        if (others >= 0).any():
            other = space.parameters[others.max()].name
            raise InputError(f"{other} and {parameter.name} write the same {parameter.field}")
        owner[parameter.field][index] = i


def refuse_unprepared(model: mujoco.MjModel, space: ParameterSpace, indices: list[tuple]) -> None:
    """Raise InputError if the compiled model ignores a parameter; MuJoCo itself does not complain.

    That is the case if an actuator has no delay buffer, filter or force limit, if the model was
    compiled without gravity compensation, or if MuJoCo simplifies a body that is not simple.
    """
    for parameter, index in zip(space, indices, strict=True):
        if not parameter.changes_model:
            continue
        rows, problem = index[0], ""
        if parameter.is_delay:
            remembered_s = model.actuator_history[rows, 0].min() * model.opt.timestep
            if parameter.high > remembered_s * (1 + 1e-6):
                problem = (
                    f"the model remembers controls for {remembered_s:g} s, less than the longest "
                    f"delay of {parameter.high:g} s"
                )
        elif parameter.is_lag and not model.actuator_dyntype[rows].all():
            problem = "the model has no filter of the control"
        elif parameter.field_info.form == "range" and not model.actuator_forcelimited[rows].all():
            problem = "the model has no limit of the force"
        elif parameter.compensates_weight and not model.ngravcomp:
            problem = "no body of the model is held against gravity"
        elif parameter.field_info.needs_all_terms:
            bodies = rows if parameter.field_info.prefix == "body" else model.jnt_bodyid[rows]
            if model.body_simple[bodies].any():
                problem = "the model was compiled with a simple body there"
        if problem:
            raise InputError(f"{parameter.name}: {problem}; Task.load_model sees to that")
