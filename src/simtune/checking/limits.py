"""Joints that the model keeps at their limits, whatever the actions."""

import mujoco
import numpy as np

from simtune.parameters.joint_types import HINGE, HINGE_OR_SLIDE
from simtune.simulation import Simulator
from simtune.simulation.servos import are_commanded

_SOFT_LIMIT_SHARE = 0.02  # of a joint's range
_MAX_STEPS_SHARE = 0.8  # at a limit
_MAX_RANGE_RAD = 4 * np.pi  # a range that a file writes as more than that is no rad


def joints_at_limits(simulator: Simulator, states: np.ndarray) -> list[str]:
    """A sentence for each joint that actions drive, and that is at its limits nearly always.

    In (E, T + 1, S) states. What no action drives, such as a gripper that is held shut, may be.
    """
    model = simulator.model
    positions = simulator.state_space.positions_and_velocities(states)
    return [
        _says(model, joint, share)
        for joint in _driven(simulator)
        if (share := _share_at_limit(model, joint, positions)) > _MAX_STEPS_SHARE
    ]


def _driven(simulator: Simulator) -> list[int]:
    """Hinges and slides with limits that an actuator acts on, as actions say."""
    model, names = simulator.model, simulator.action_mapping.names
    of_joints = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    of_joints &= are_commanded(model, names)
    return [
        joint
        for joint in np.unique(model.actuator_trnid[of_joints, 0]).tolist()
        if model.jnt_limited[joint] and model.jnt_type[joint] in HINGE_OR_SLIDE
    ]


def _share_at_limit(model: mujoco.MjModel, joint: int, positions: np.ndarray) -> float:
    """Of (E, T + 1, nq + nv)."""
    low, high = model.jnt_range[joint]
    at = positions[..., model.jnt_qposadr[joint]]
    slack = _SOFT_LIMIT_SHARE * (high - low)
    return float(np.mean((at < low + slack) | (at > high - slack)))


def _says(model: mujoco.MjModel, joint: int, share: float) -> str:
    low, high = model.jnt_range[joint]
    is_hinge = model.jnt_type[joint] == HINGE
    unit = "rad" if is_hinge else "m"
    may_be_radians = is_hinge and np.rad2deg(high - low) < _MAX_RANGE_RAD
    doubt = "; is its range in degrees where radians are meant?" * bool(may_be_radians)
    name = model.joint(joint).name or joint
    return (
        f"joint {name} is at its limits, {low:.3g} to {high:.3g} {unit}, in {share:.0%} of the "
        f"simulator's steps, so actions hardly move it{doubt}"
    )
