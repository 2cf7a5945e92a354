"""Objects that nothing holds: boxes to be pushed, balls to be thrown."""

import mujoco
import numpy as np

_FREE = mujoco.mjtJoint.mjJNT_FREE.value


def loose_joints(model: mujoco.MjModel) -> np.ndarray:
    """Joints of free bodies in trees of their own; none with tendons or constraints."""
    if model.ntendon or model.neq:
        return np.zeros(0, int)
    alone = np.bincount(model.body_rootid[model.jnt_bodyid], minlength=model.nbody) == 1
    return np.flatnonzero((model.jnt_type == _FREE) & alone[model.jnt_bodyid])


def loose_places(model: mujoco.MjModel) -> list[int]:
    """Where each one's three coordinates and its quaternion begin among positions."""
    return model.jnt_qposadr[loose_joints(model)].tolist()
