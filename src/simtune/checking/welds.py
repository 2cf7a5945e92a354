"""A mocap body's weld that turns what it holds, wherever an episode begins."""

import mujoco
import numpy as np

from simtune.checking.nominal import nominal_starts
from simtune.simulation import Simulator
from simtune.simulation.mocap import MocapActions

_TURNED_RAD = 0.3
_MAX_STARTS = 8
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_EQUALITY = mujoco.mjtConstraint.mjCNSTR_EQUALITY.value
_POSITION_ROWS = 3  # of a weld, before those of its turn


def turning_welds(simulator: Simulator, seed: int) -> list[str]:
    """A sentence if actions move a mocap body whose weld turns a hand before anything moves.

    In nominal worlds; of starts that differ, the one that it turns least counts.
    """
    mapping = simulator.action_mapping
    if not isinstance(mapping, MocapActions):
        return []
    model, held = simulator.model, mapping.held
    starts = nominal_starts(simulator, seed)[:_MAX_STARTS]
    angle = min(_turn_rad(model, held.equality, start) for start in starts)
    if angle < _TURNED_RAD:
        return []
    mocap, hand = model.body(held.mocap_body).name, model.body(held.body).name
    return [
        f"the weld of {mocap} turns {hand} by {angle:.2g} rad ({np.rad2deg(angle):.0f}°) from how "
        "episodes begin, before any action: give it the relpose that reality has, or the keyframe "
        "the mocap body's orientation (mquat)"
    ]


def _turn_rad(model: mujoco.MjModel, equality: int, state: np.ndarray) -> float:
    """By which a weld turns one of its bodies in a full state; 0 of a <connect>.

    The last three residuals of a weld are the vector part of a unit quaternion, sin(θ / 2) long,
    times its torquescale.
    """
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, _STATE)
    mujoco.mj_forward(model, data)
    mine = (data.efc_type == _EQUALITY) & (data.efc_id == equality)
    turn = data.efc_pos[mine][_POSITION_ROWS:]
    scale = model.eq_data[equality, 10]
    return 2 * float(np.arcsin(min(1.0, np.linalg.norm(turn) / scale))) if turn.size else 0.0
