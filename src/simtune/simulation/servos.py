"""Which actuators are servos, and where, or how fast, a control sends a joint."""

from collections.abc import Collection

import mujoco
import numpy as np

from simtune.parameters.fields import FOLLOWS, OF_JOINTS

_AFFINE = mujoco.mjtBias.mjBIAS_AFFINE.value
# A servo of speeds reaches most of what it is sent, within most times that a command is held
_MIN_BRAKE_SHARE, _MAX_SETTLING_S = 0.5, 0.3


def position_servos(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a force pulls a joint to where the control says, perhaps filtered.

    Not <intvelocity>, whose control is a velocity.
    """
    return pulls_to_a_place(model) & np.isin(model.actuator_dyntype, FOLLOWS)


def pulls_to_a_place(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: servos of positions, and <intvelocity>, which goes on from a place."""
    return (model.actuator_biastype == _AFFINE) & (model.actuator_biasprm[:, 1] < 0)


def velocity_servos(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a force brings a joint to the speed that the control says.

    Nearly, and soon: not a motor whose voltage is the control, which its own back-EMF brakes.
    """
    return _brakes(model) & _is_stiff(model) & np.isin(model.actuator_dyntype, FOLLOWS)


def _brakes(model: mujoco.MjModel) -> np.ndarray:
    bias = model.actuator_biasprm
    return (model.actuator_biastype == _AFFINE) & (bias[:, 1] == 0) & (bias[:, 2] < 0)


def _is_stiff(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a joint's own damping and inertia hardly keep it from its speed.

    True for what moves no single joint.
    """
    stiff = np.ones(model.nactuator, bool)
    for i in np.flatnonzero(np.isin(model.actuator_trntype, OF_JOINTS)):
        dof = model.jnt_dofadr[model.actuator_trnid[i, 0]]
        gear = model.actuator_gear[model.actuator_outadr[i], 0]
        brakes = -model.actuator_biasprm[i, 2] * gear**2
        all_brake = brakes + model.dof_damping[dof]
        is_soon = model.dof_M0[dof] <= _MAX_SETTLING_S * all_brake
        stiff[i] = brakes >= _MIN_BRAKE_SHARE * all_brake and is_soon
    return stiff


def motors(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a control is a force wherever the joint is, perhaps braked."""
    pushes = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value
    pushes |= _brakes(model) & ~_is_stiff(model)
    is_fixed = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED.value
    return pushes & is_fixed & np.isin(model.actuator_dyntype, FOLLOWS)


def joint_target(model: mujoco.MjModel, servo: int) -> tuple[float, float]:
    """A servo sends its joint to the position, or speed, `shift` + `factor` · control.

    Returns (shift, factor). Its gear must not be 0.
    """
    gear = model.actuator_gear[model.actuator_outadr[servo], 0]
    constant, per_position, per_speed = model.actuator_biasprm[servo, :3]
    per_length = 1 / (-(per_position or per_speed) * gear)
    return float(constant * per_length), float(model.actuator_gainprm[servo, 0] * per_length)


def actuator_name(model: mujoco.MjModel, actuator: int) -> str:
    """As actions call it: parts without a name are numbered."""
    return model.actuator(actuator).name or f"actuator {actuator}"


def are_commanded(model: mujoco.MjModel, names: Collection[str]) -> np.ndarray:
    """(nactuator,) bool: whether one of the actions with these `names` is the actuator's."""
    return np.array([actuator_name(model, i) in names for i in range(model.nactuator)], bool)


def is_clipped(model: mujoco.MjModel) -> np.ndarray:
    """(nu,) bool: whether MuJoCo clips a control to its range."""
    is_off = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL.value)
    return np.asarray(model.actuator_ctrllimited, bool) & (not is_off)


def control_limits(model: mujoco.MjModel, control: int) -> tuple[float, float]:
    """What MuJoCo clips a control to; infinite where it does not."""
    clips = is_clipped(model)[control]
    low, high = model.actuator_ctrlrange[control] if clips else (-np.inf, np.inf)
    return float(low), float(high)
