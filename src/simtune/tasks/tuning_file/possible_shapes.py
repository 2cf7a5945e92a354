"""What objects allow: how many numbers of a size or equality count, and possible inertias."""

from collections.abc import Set
from math import inf
from typing import Literal

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters import Parameter, rows_of
from simtune.parameters.fields import FEW_SIZES
from simtune.tasks.tuning_file.units import moves_slide

_FEW_DATA = {
    mujoco.mjtEq.mjEQ_CONNECT.value: ("connect", 6),
    mujoco.mjtEq.mjEQ_JOINT.value: ("joint equality", 5),
    mujoco.mjtEq.mjEQ_TENDON.value: ("tendon equality", 5),
    mujoco.mjtEq.mjEQ_WELD.value: ("weld", 11),
}
# {field: {type of its objects: its name, and how many numbers count}}, where fewer than the row has
_FEW = {"geom_size": FEW_SIZES, "site_size": FEW_SIZES, "eq_data": _FEW_DATA}
_EXPORTED = 1e-5  # relative: exported numbers are rounded, and MuJoCo forgives no such difference
_ROUNDING = 1e-9


def check_sizes(model: mujoco.MjModel, parameter: Parameter) -> None:
    """Raises InputError for components of a size, or data, that an object's type does not have."""
    few, component = _FEW.get(parameter.field), parameter.component
    if few is None or (component is None and parameter.is_factor):
        return
    width = parameter.field_info.read(model).shape[1]
    types = getattr(model, f"{parameter.field_info.prefix}_type")
    for name in parameter.objects:
        kind = types[rows_of(model, parameter.field, name)].item()
        its_type, count = few.get(kind, ("", width))
        if count < width and (component is None or component >= count):
            last = f" {'and' if count == 2 else 'to'} {count - 1}"
            has = "component 0" if count == 1 else f"components 0{last}"
            got = "none: say which" if component is None else f"component = {component}"
            what = parameter.field.partition("_")[2]
            raise InputError(f"{name} is a {its_type}, whose {what} has {has}, got {got}")


def usual_range(
    model: mujoco.MjModel, parameter: Parameter, nominal: float, unsure: Set[str]
) -> tuple[float | None, float | None, Literal["log", "linear"]]:
    """The field's (low, high, scale) around a nominal value, without impossible inertias.

    `unsure`: see `check_inertia`.
    """
    is_slide = moves_slide(model, parameter)
    low, high, scale = parameter.field_info.usual_range(nominal, is_slide)
    least, most = _inertia_limits(model, parameter, unsure)
    if low is not None:
        low = max(low, min(nominal, least * (1 + _EXPORTED)))
    if high is not None:
        high = min(high, max(nominal, most * (1 - _EXPORTED)))
    return low, high, scale


def check_inertia(
    model: mujoco.MjModel, parameter: Parameter, unsure: Set[str], *values: float
) -> None:
    """Raises InputError for an inertia that no body has beside its other two (MuJoCo's A + B ≥ C).

    They are taken as the model has them, except of bodies where they are `unsure` themselves.
    """
    least, most = _inertia_limits(model, parameter, unsure)
    for value in values:
        if not least * (1 - _ROUNDING) <= value <= most * (1 + _ROUNDING):
            raise InputError(
                f"{parameter.name}: no body has the inertia {value:g} beside the other two: "
                f"expected {least:g} to {most:g}, from their difference to their sum"
            )


def _inertia_limits(
    model: mujoco.MjModel, parameter: Parameter, unsure: Set[str]
) -> tuple[float, float]:
    """(low, high) of a component of `body_inertia`; other parameters have no such limits."""
    sure = [name for name in parameter.objects if name not in unsure]
    if parameter.field != "body_inertia" or parameter.component is None or not sure:
        return -inf, inf
    rows = np.concatenate([rows_of(model, parameter.field, name) for name in sure])
    inertia = model.body_inertia[rows]
    own, others = inertia[:, parameter.component], np.delete(inertia, parameter.component, 1)
    least, most = np.abs(others[:, 0] - others[:, 1]), others.sum(1)
    if parameter.is_factor:
        least, most = least[own > 0] / own[own > 0], most[own > 0] / own[own > 0]
    return float(least.max()), float(most.min())
