"""Types of joints as the numbers that MuJoCo's arrays hold.

MuJoCo's enums equal these only half of the time: with an array or a number taken from one on the
left, `==` holds, but `enum == number` and `number in (enum,)` are False. These compare either way.
"""

import mujoco

HINGE = mujoco.mjtJoint.mjJNT_HINGE.value
SLIDE = mujoco.mjtJoint.mjJNT_SLIDE.value
BALL = mujoco.mjtJoint.mjJNT_BALL.value
FREE = mujoco.mjtJoint.mjJNT_FREE.value
HINGE_OR_SLIDE = (HINGE, SLIDE)
