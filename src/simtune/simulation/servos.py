"""Which actuators are servos, and where, or how fast, a control sends a joint."""

import mujoco
import numpy as np

from simtune.parameters.fields import FOLLOWS

_AFFINE = mujoco.mjtBias.mjBIAS_AFFINE.value


def position_servos(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a force pulls a joint to where the control says, perhaps filtered.

    Not <intvelocity>, whose control is a velocity.
    """
    return pulls_to_a_place(model) & np.isin(model.actuator_dyntype, FOLLOWS)


def pulls_to_a_place(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: servos of positions, and <intvelocity>, which goes on from a place."""
    return (model.actuator_biastype == _AFFINE) & (model.actuator_biasprm[:, 1] < 0)


def velocity_servos(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a force brings a joint to the speed that the control says."""
    bias = model.actuator_biasprm
    brakes = (model.actuator_biastype == _AFFINE) & (bias[:, 1] == 0) & (bias[:, 2] < 0)
    return brakes & np.isin(model.actuator_dyntype, FOLLOWS)


def motors(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a force is as large as the control says, wherever the joint is."""
    has_none = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value
    is_fixed = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED.value
    return has_none & is_fixed & np.isin(model.actuator_dyntype, FOLLOWS)


def joint_target(model: mujoco.MjModel, servo: int) -> tuple[float, float]:
    """A servo sends its joint to the position, or speed, `shift` + `factor` · control.

    Returns (shift, factor). Its gear must not be 0.
    """
    gear = model.actuator_gear[model.actuator_outadr[servo], 0]
    bias = model.actuator_biasprm[servo]
    per_length = 1 / (-(bias[1] or bias[2]) * gear)
    bias, gain = model.actuator_biasprm[servo, 0], model.actuator_gainprm[servo, 0]
    return float(bias * per_length), float(gain * per_length)


def actuator_name(model: mujoco.MjModel, actuator: int) -> str:
    """As actions call it: parts without a name are numbered."""
    return model.actuator(actuator).name or f"actuator {actuator}"


def is_clipped(model: mujoco.MjModel) -> np.ndarray:
    """(nu,) bool: whether MuJoCo clips a control to its range."""
    is_off = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL.value)
    return np.asarray(model.actuator_ctrllimited, bool) & (not is_off)


def control_limits(model: mujoco.MjModel, control: int) -> tuple[float, float]:
    """What MuJoCo clips a control to; infinite where it does not."""
    clips = is_clipped(model)[control]
    low, high = model.actuator_ctrlrange[control] if clips else (-np.inf, np.inf)
    return float(low), float(high)
