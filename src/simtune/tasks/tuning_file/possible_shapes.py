"""What shapes and bodies allow: how many numbers a size has, and which inertias there are."""

from math import inf
from typing import Literal

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters import Parameter, rows_of
from simtune.tasks.tuning_file.field_defaults import moves_slide

_FEW_SIZES = {  # shapes whose size is fewer than three numbers
    mujoco.mjtGeom.mjGEOM_SPHERE.value: ("sphere", 1),
    mujoco.mjtGeom.mjGEOM_CAPSULE.value: ("capsule", 2),
    mujoco.mjtGeom.mjGEOM_CYLINDER.value: ("cylinder", 2),
}
_EXPORTED = 1e-5  # relative: exported numbers are rounded, and MuJoCo forgives no such difference
_ROUNDING = 1e-9


def check_sizes(model: mujoco.MjModel, parameter: Parameter) -> None:
    """Raises InputError for components of a size that an object's shape does not have."""
    if parameter.field not in ("geom_size", "site_size"):
        return
    component = parameter.component
    if component is None and parameter.is_factor:
        return
    types = getattr(model, f"{parameter.field_info.prefix}_type")
    for name in parameter.objects:
        kind = types[rows_of(model, parameter.field, name)].item()
        shape, count = _FEW_SIZES.get(kind, ("", 3))
        if count < 3 and (component is None or component >= count):
            has = "component 0" if count == 1 else "components 0 and 1"
            got = "none: say which" if component is None else f"component = {component}"
            raise InputError(f"{name} is a {shape}, whose size has {has}, got {got}")


def usual_range(
    model: mujoco.MjModel, parameter: Parameter, nominal: float
) -> tuple[float | None, float | None, Literal["log", "linear"]]:
    """The field's (low, high, scale) around a nominal value, without impossible inertias."""
    is_slide = moves_slide(model, parameter)
    low, high, scale = parameter.field_info.usual_range(nominal, is_slide)
    least, most = _inertia_limits(model, parameter)
    if low is not None:
        low = max(low, min(nominal, least * (1 + _EXPORTED)))
    if high is not None:
        high = min(high, max(nominal, most * (1 - _EXPORTED)))
    return low, high, scale


def check_inertia(model: mujoco.MjModel, parameter: Parameter, *values: float) -> None:
    """Raises InputError for an inertia that no body has beside its other two (MuJoCo's A + B ≥ C).

    They are taken as the model has them.
    """
    least, most = _inertia_limits(model, parameter)
    for value in values:
        if not least * (1 - _ROUNDING) <= value <= most * (1 + _ROUNDING):
            raise InputError(
                f"{parameter.name}: no body has the inertia {value:g} beside the other two: "
                f"expected {least:g} to {most:g}, from their difference to their sum"
            )


def _inertia_limits(model: mujoco.MjModel, parameter: Parameter) -> tuple[float, float]:
    """(low, high) of a component of `body_inertia`; other parameters have no such limits."""
    if parameter.field != "body_inertia" or parameter.component is None:
        return -inf, inf
    rows = np.concatenate([rows_of(model, parameter.field, name) for name in parameter.objects])
    inertia = model.body_inertia[rows]
    own, others = inertia[:, parameter.component], np.delete(inertia, parameter.component, 1)
    least, most = np.abs(others[:, 0] - others[:, 1]), others.sum(1)
    if parameter.is_factor:
        least, most = least[own > 0] / own[own > 0], most[own > 0] / own[own > 0]
    return float(least.max()), float(most.min())
