"""What a policy is trained for: swing the pendulum up, and keep it there."""

import numpy as np


def swing_up(data):
    """(n,) in [0, 1]: how high the bob is.

    `data` is MjData of n worlds at once: qpos is (n, 3), of the rail, the hinge and the block.
    """
    angle_rad = data.qpos[:, 1]
    return (1 - np.cos(angle_rad)) / 2
