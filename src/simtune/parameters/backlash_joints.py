"""Backlash: the play of gears, modelled as a second joint in series with the driven joint.

MuJoCo has no backlash of its own. Models with backlash (e.g. those made by onshape-to-robot) give a
body a second, undriven joint about the same axis, whose limits are the play. The motor's side turns
by the driven joint alone; the driven body turns by the sum of both.
"""

import mujoco
import numpy as np


def play_of(model: mujoco.MjModel, joint: int) -> int:
    """Index of the joint that is the play of `joint`; -1 if it has none."""
    others = np.flatnonzero(model.jnt_bodyid == model.jnt_bodyid[joint])
    plays = (i for i in others.tolist() if i != joint and driven_through(model, i) == joint)
    return next(plays, -1)


def driven_through(model: mujoco.MjModel, play: int) -> int:
    """Index of the driven joint in series with the joint `play`; -1 if `play` is not a play.

    Both joints belong to one body and have the same type, position and axis. The play comes after
    the driven joint, and its limits are symmetric about 0.
    """
    low, high = model.jnt_range[play]
    if not model.jnt_limited[play] or low != -high:
        return -1
    body = model.jnt_bodyid == model.jnt_bodyid[play]
    for joint in np.flatnonzero(body[:play]):
        is_alike = model.jnt_type[joint] == model.jnt_type[play]
        for field in (model.jnt_axis, model.jnt_pos):
            is_alike = is_alike and np.allclose(field[joint], field[play], atol=1e-6)
        if is_alike:
            return int(joint)
    return -1
