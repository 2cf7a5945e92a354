"""Defaults of a tuning file, taken from the model, and checks that a field can be tuned."""

import difflib
from collections.abc import Iterable
from dataclasses import replace

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS

from simtune.errors import InputError
from simtune.parameters import Parameter, field_of, rows_of
from simtune.parameters.field_index import field_index
from simtune.parameters.fields import KINDS
from simtune.parameters.model_writer import start_from_material
from simtune.parameters.tunable import why_not_tunable
from simtune.tasks.tuning_file.shared_limits import limits_of_driven, refuse_shared

_MODEL = mujoco.MjModel
# Only of meshes is a geom_aabb not derived
_DERIVED = {*_MODEL._setconst_outputs} - {*_MODEL._setconst_inputs} | {"geom_aabb"}
# What actuators without a gain have instead, by components of actuator_gainprm
_GAIN = mujoco.mjtGain
_NO_GAINS = {
    _GAIN.mjGAIN_MUSCLE.value: "muscle, whose force is component 2, or 3, if that is −1",
    _GAIN.mjGAIN_DCMOTOR.value: "<dcmotor>, whose torque constant is component 1, resistance 0",
    _GAIN.mjGAIN_AFFINE.value: "<damper>, whose −kv is component 2",
}


def own_values(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """The model's values at the places that the parameter writes; of any shape.

    Raises UnknownName for an unknown object, InputError if the parameter cannot be written.
    """
    field, values = parameter.field, parameter.field_info.read(model)
    index = field_index(model, parameter, {field: values})
    if parameter.is_colour:
        values = values.copy()
        start_from_material(values, np.unique(index[0]), model, field)
    return values[index]


def check_field(model: mujoco.MjModel, field: str) -> None:
    """Raises InputError if there is no such field, or it holds no real numbers of its own."""
    if field not in MODEL_FIELDS:
        usual = ", ".join(sorted(f.name for f, kind in KINDS.values() if kind.makes == "number"))
        close = difflib.get_close_matches(field, MODEL_FIELDS, n=1)
        meant = f"did you mean {close[0]!r}? " if close else ""
        raise InputError(f"no field {field!r} in MjModel; {meant}usual ones are: {usual}")
    if reason := field_of(field).not_tunable:
        raise InputError(reason)
    if field in _DERIVED:
        raise InputError(
            f"MuJoCo derives {field} from sizes, masses, places and gears: tune what it follows "
            "from, such as geom_size, body_mass or body_pos"
        )
    if not np.issubdtype(field_of(field).read(model).dtype, np.floating):
        raise InputError(f"{field} holds no real numbers, so it cannot be tuned")


def check_component(model: mujoco.MjModel, parameter: Parameter) -> None:
    """Raises InputError for a component that the field's rows do not have, or that is derived."""
    field, component = parameter.field, parameter.component
    values = parameter.field_info.read(model)
    width = values.shape[-1] if values.ndim == 1 + (not parameter.field_info.is_option) else 0
    if component is not None and not parameter.is_rotation and component >= width:
        has = f"components 0 to {width - 1}" if width else "no components"
        raise InputError(f"{field} has {has}, got component = {component}")
    if (own := parameter.field_info.components) and component not in own:
        got = "none: say which" if component is None else f"component = {component}"
        raise InputError(f"{field} is tuned by components {own[0]} to {own[-1]}, got {got}")


def check_objects(model: mujoco.MjModel, parameter: Parameter) -> None:
    """Raises InputError for objects whose value of the field cannot be tuned."""
    for name in parameter.objects:
        rows = rows_of(model, parameter.field, name)
        if problem := why_not_tunable(parameter.field_info, model, rows, name):
            raise InputError(problem)
    if parameter.field_info.form == "range":
        values = own_values(model, parameter)
        refuse_shared(model, parameter.objects, _own_limits(model, parameter, values))
        if parameter.is_factor:
            _without_form(model, parameter, values)


def check_factor(model: mujoco.MjModel, parameter: Parameter, named: Iterable[str]) -> None:
    """Raises InputError if the factor on several objects leaves all or one `named` as they are.

    A pattern may choose such objects beside others.
    """
    if not parameter.is_factor:
        return
    if parameter.field_info.form == "itself":
        _refuse_zeros(model, parameter, own_values(model, parameter))
    for name in named:
        one = replace(parameter, objects=(name,))
        values = own_values(model, one)
        if parameter.field_info.form != "itself":
            values = _without_form(model, one, values)
        if not values.any():
            raise InputError(
                f"{name} has 0 there ({parameter.field}), so a factor does not change it: leave it "
                "out, give it another value in the model, or a parameter of its own"
            )


def check_gains(model: mujoco.MjModel, actuators: Iterable[str]) -> None:
    """Raises InputError for actuators of which no number is a gain."""
    for name in actuators:
        actuator = model.actuator(name)
        kind = actuator.gaintype[0]
        if kind in _NO_GAINS and not (kind == _GAIN.mjGAIN_AFFINE and actuator.gainprm[0]):
            raise InputError(
                f'{name} has no gain: it is a {_NO_GAINS[kind]} of field = "actuator_gainprm"'
            )


def check_gears(model: mujoco.MjModel, actuators: Iterable[str]) -> None:
    """Raises InputError for actuators whose gear lies in other components, as a thruster's does."""
    for name in actuators:
        (gear,) = model.actuator_gear[rows_of(model, "actuator_gear", name)]
        if gear[0] == 0 and (others := [str(i) for i in np.flatnonzero(gear)]):
            raise InputError(
                f'{name} has a gear of 0 in component 0, which kind = "gear" tunes, but not in '
                f'{" and ".join(others)}: say field = "actuator_gear" and component = {others[0]}, '
                'or kind = "gain", which scales all that it does'
            )


def own_nominal(model: mujoco.MjModel, parameter: Parameter) -> float:
    """The parameter's nominal value, from the model. Raises InputError if there are several."""
    values, info = own_values(model, parameter), parameter.field_info
    if parameter.is_rotation or info.form == "shift":
        return 0.0
    if info.usual is not None and not _has_own(model, parameter).all():
        return info.usual
    if info.form != "itself":
        values = _without_form(model, parameter, values)
    if parameter.is_factor:
        _refuse_zeros(model, parameter, values)
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


def _refuse_zeros(model: mujoco.MjModel, parameter: Parameter, values: np.ndarray) -> None:
    """Raises InputError if all objects of a factor have the value 0."""
    if not values.any():
        of, _, attribute = parameter.field.partition("_")
        one = f"the joints a {attribute}" if of in ("dof", "jnt") else "it another value"
        flexes = " (a flex's elasticity and damping cannot be tuned)" if model.nflex else ""
        raise InputError(
            f"{parameter.field} is 0 there, so a factor changes nothing: give {one} in the model"
            f"{flexes}"
        )


def _has_own(model: mujoco.MjModel, parameter: Parameter) -> np.ndarray:
    """(objects,) bool: whether the object has the filter, limit or compensation to be tuned."""
    if parameter.compensates_weight:
        return own_values(model, parameter) > 0
    ids = [model.actuator(name).id for name in parameter.objects]
    return (model.actuator_dyntype if parameter.is_lag else model.actuator_forcelimited)[ids] > 0


def _without_form(model: mujoco.MjModel, parameter: Parameter, values: np.ndarray) -> np.ndarray:
    """The parameter values behind a field's negatives or ranges; see `Kind.form`.

    Raises InputError for a missing or asymmetric range.
    """
    if parameter.field_info.form == "negative":
        return -values
    if parameter.field_info.form == "play":
        return values[:, 1] - values[:, 0]
    own, others = _own_limits(model, parameter, values), limits_of_driven(model, parameter.objects)
    limits = np.stack([np.fmax(own[:, 0], others[:, 0]), np.fmin(own[:, 1], others[:, 1])], 1)
    for name, (low, high) in zip(parameter.objects, limits, strict=True):  # the narrower one acts
        if np.isnan(low):
            wanted = "say nominal" if len(values) == 1 else "give it a parameter of its own"
            raise InputError(f"{name} has no limit (forcerange) in the model: {wanted}")
        if low != -high:
            raise InputError(
                f"{name} has a forcerange of {low:g} to {high:g}, which no limit to both sides "
                "makes: say nominal"
            )
    return limits[:, 1]


def _own_limits(model: mujoco.MjModel, parameter: Parameter, values: np.ndarray) -> np.ndarray:
    """The (objects, 2) `values` of actuators' own limits; NaN: none."""
    return np.where(_has_own(model, parameter)[:, None], values, np.nan)
