"""Where an object's numbers are."""

import mujoco
import numpy as np


def rows_of_object(model: mujoco.MjModel, kind: str, name: str) -> np.ndarray:
    """Rows of the object's fields: of a joint's degrees of freedom as many as it has, else one.

    Raises KeyError, which lists the names that there are.
    """
    if kind == "dof":
        return np.flatnonzero(model.dof_jntid == model.joint(name).id)
    if kind in ("qpos0", "qpos"):
        return model.joint(name).qposadr[:1]
    return np.array([getattr(model, kind)(name).id])
