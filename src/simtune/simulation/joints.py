"""Where joints are: in a state, and above each other."""

import mujoco
import numpy as np


def joints_of_state(model: mujoco.MjModel) -> np.ndarray:
    """(nq + nv,) the joint of each position and velocity."""
    of_positions = np.repeat(np.arange(model.njnt), np.diff([*model.jnt_qposadr, model.nq]))
    return np.append(of_positions, model.dof_jntid)


def joints_up_from(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints of a body and of those that carry it, the nearest first."""
    joints = list[int]()
    while body > 0:
        first = int(model.body_jntadr[body])
        joints += reversed(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return joints


def dofs_above(model: mujoco.MjModel, body: int) -> set[int]:
    """Indices of the velocities that move a body."""
    moves = np.isin(model.dof_jntid, joints_up_from(model, body))
    return set(np.flatnonzero(moves).tolist())
