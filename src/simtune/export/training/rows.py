"""Rows of an object in a model's fields."""

import mujoco
import numpy as np


def rows_of_object(model: mujoco.MjModel, kind: str, name: str) -> np.ndarray:
    """Rows of an object's fields: one, or for a joint's "dof" fields one per degree of freedom.

    Raises KeyError, which lists the valid names.
    """
    if kind == "dof":
        return np.flatnonzero(model.dof_jntid == model.joint(name).id)
    if kind in ("qpos0", "qpos"):
        return model.joint(name).qposadr[:1]
    return np.array([getattr(model, kind)(name).id])
