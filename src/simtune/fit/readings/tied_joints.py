"""Joints that the model ties to measured ones: the second finger of a gripper."""

import mujoco
import numpy as np

from simtune.simulation.ties import joint_ties


def follow_measured(model: mujoco.MjModel, states: np.ndarray, places: np.ndarray) -> None:
    """Put joints where active equalities tie them to measured ones, in (..., nq + nv) `states`.

    `places`: indices of the positions that are measured. An equality says, with y and x relative to
    the model's own pose,

        y = a₀ + a₁ x + a₂ x² + a₃ x³ + a₄ x⁴

    It is used to find x from y only where it is linear. A chain may be written in any order.
    """
    measured, ties = set(places.tolist()), joint_ties(model)
    while ties:
        done = [tie for tie in ties if _put(model, states, measured, tie)]
        if not done:
            return
        ties = [tie for tie in ties if tie not in done]


def _put(model: mujoco.MjModel, states: np.ndarray, measured: set[int], tie: int) -> bool:
    """Put one of two tied joints where the other says, which then counts as measured; whether."""
    follower, leader = int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])
    factors = model.eq_data[tie, :5]
    if model.jnt_qposadr[leader] not in measured:
        if factors[2:].any() or not factors[1]:
            return False
        factors = np.array([-factors[0], 1.0, 0, 0, 0]) / factors[1]
        follower, leader = leader, follower
    to, by = model.jnt_qposadr[follower], model.jnt_qposadr[leader]
    if by not in measured or to in measured:
        return False
    polynomial = np.polynomial.Polynomial(factors)
    away = states[..., by] - model.qpos0[by]
    states[..., to] = model.qpos0[to] + polynomial(away)
    speed, speeds = model.nq + model.jnt_dofadr[follower], model.nq + model.jnt_dofadr[leader]
    states[..., speed] = polynomial.deriv()(away) * states[..., speeds]
    measured.add(int(to))
    return True
