"""Compares a model with what MuJoCo reads from the MJCF written of it."""

from collections.abc import Iterable

import mujoco
import numpy as np

from simtune.parameters import field_of
from simtune.parameters.fields import FEW_SIZES

_TINY = 1e-6  # kg·m²; MJCF has no numbers below 1e-12


def compare(reloaded: mujoco.MjModel, model: mujoco.MjModel, fields: Iterable[str]) -> None:
    """Raise RuntimeError if a field has changed: MJCF cannot express every field of a model."""
    for field in sorted(fields):
        before, after = _values(model, field), _values(reloaded, field)
        atol = 1e-4 if field == "body_iquat" else 1e-6
        if before.shape != after.shape or not np.allclose(before, after, rtol=1e-4, atol=atol):
            raise RuntimeError(f"MuJoCo writes no {field} into MJCF, so it cannot be exported")


def _values(model: mujoco.MjModel, field: str) -> np.ndarray:
    """A field's values as far as they have an effect: others need not be in the MJCF."""
    values = field_of(field).read(model)
    if field in ("geom_size", "site_size"):
        types = getattr(model, field.replace("size", "type"))
        used = np.array([FEW_SIZES.get(kind, ("", 3))[1] for kind in types], int)
        return np.where(np.arange(3) < used[:, None], values, 0)
    return _inertias(model) if field == "body_iquat" else values


def _inertias(model: mujoco.MjModel) -> np.ndarray:
    """(nbody, 3, 3) inertias about the bodies' axes, in units of each body's largest moment.

    Where two moments are equal, many body_iquat mean the same one.
    """
    axes = np.empty((model.nbody, 9))
    for matrix, quat in zip(axes, model.body_iquat, strict=True):
        mujoco.mju_quat2Mat(matrix, quat)
    axes = axes.reshape(-1, 3, 3)
    largest = np.maximum(model.body_inertia.max(1, keepdims=True), _TINY)
    return np.einsum("bij,bj,bkj->bik", axes, model.body_inertia / largest, axes)
