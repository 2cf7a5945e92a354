"""Which actuators are servos of positions."""

import mujoco
import numpy as np

_AFFINE = mujoco.mjtBias.mjBIAS_AFFINE.value
_DYN = mujoco.mjtDyn
_FOLLOWS = (_DYN.mjDYN_NONE.value, _DYN.mjDYN_FILTER.value, _DYN.mjDYN_FILTEREXACT.value)


def position_servos(model: mujoco.MjModel) -> np.ndarray:
    """(nu,) bool: whether a force pulls a joint to a place that the control sets, perhaps filtered.

    Not <intvelocity>, whose control is a velocity.
    """
    pulls = (model.actuator_biastype == _AFFINE) & (model.actuator_biasprm[:, 1] < 0)
    return pulls & np.isin(model.actuator_dyntype, _FOLLOWS)
