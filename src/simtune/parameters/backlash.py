"""Backlash: the play of gears, as a second joint in series with the one that is driven.

MuJoCo has none of its own. Models that have it (those made by onshape-to-robot, for one) give a
body a further joint about the same axis, which nothing drives and whose limits are the play: the
motor's side turns by the one, what it moves by both.
"""

import mujoco
import numpy as np


def play_of(model: mujoco.MjModel, joint: int) -> int:
    """The joint that is the play of `joint`, -1 if there is none."""
    others = np.flatnonzero(model.jnt_bodyid == model.jnt_bodyid[joint])
    plays = (i for i in others.tolist() if i != joint and driven_through(model, i) == joint)
    return next(plays, -1)


def driven_through(model: mujoco.MjModel, play: int) -> int:
    """The joint in series with `play`, -1 if that is no play.

    Both are of one body, of one type, place and axis; the play comes later, and has limits about
    its 0.
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
