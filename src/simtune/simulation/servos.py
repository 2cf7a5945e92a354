"""Which actuators are servos of positions, and where a control sends a joint."""

import mujoco
import numpy as np

from simtune.parameters.fields import FOLLOWS

_AFFINE = mujoco.mjtBias.mjBIAS_AFFINE.value


def position_servos(model: mujoco.MjModel) -> np.ndarray:
    """(nactuator,) bool: whether a force pulls a joint to where the control says, perhaps filtered.

    Not <intvelocity>, whose control is a velocity.
    """
    pulls = (model.actuator_biastype == _AFFINE) & (model.actuator_biasprm[:, 1] < 0)
    return pulls & np.isin(model.actuator_dyntype, FOLLOWS)


def joint_target(model: mujoco.MjModel, servo: int) -> tuple[float, float]:
    """A position servo sends its joint to `shift` + `factor` · control: (shift, factor).

    Its gear must not be 0.
    """
    gear = model.actuator_gear[model.actuator_outadr[servo], 0]
    per_length = 1 / (-model.actuator_biasprm[servo, 1] * gear)
    bias, gain = model.actuator_biasprm[servo, 0], model.actuator_gainprm[servo, 0]
    return float(bias * per_length), float(gain * per_length)


def is_clipped(model: mujoco.MjModel) -> np.ndarray:
    """(nu,) bool: whether MuJoCo clips a control to its range."""
    is_off = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL.value)
    return np.asarray(model.actuator_ctrllimited, bool) & (not is_off)


def control_limits(model: mujoco.MjModel, control: int) -> tuple[float, float]:
    """What MuJoCo clips a control to; infinite where it does not."""
    clips = is_clipped(model)[control]
    low, high = model.actuator_ctrlrange[control] if clips else (-np.inf, np.inf)
    return float(low), float(high)
