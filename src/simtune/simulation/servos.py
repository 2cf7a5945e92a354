"""Which actuators are servos of positions."""

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
