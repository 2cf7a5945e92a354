"""Rope peg-in-hole: an arm lowers a peg, which hangs on a rope, into the hole of a tilted box.

After Du et al. 2021 (arXiv:2104.07662, Sec. V), with our own scene. Two differences: the arm starts
higher (z 1.0 m instead of 0.87 m), so that longer ropes also hang clear of the table; and the rope
is always taut, since their rope is a tendon, which the ray caster does not draw.

Success is harder than theirs, where a peg 6 cm from the hole's middle has succeeded, even if it
lies on the rim, and at any time within 60 steps. Here the whole peg has to be in the hole after 15
steps, half as many again as the script needs, and to stay there.
"""

import numpy as np
from mujoco.batch import Batch

from simtune.parameters import Parameter, colour, dynamics
from simtune.tasks.task import Task
from simtune.tasks.xarm7.scene import arm_task, lighting, place_of, start_arm, towards

_WORKSPACE_M = [[-0.25, 0.25], [0.196, 0.546], [0.8, 1.02]]  # of the hand
_UP = np.array([0.0, 0.0, 1.0])
_SWING_STD = 0.05  # rad, of the rope at the start
_ABOVE_M = 0.06  # height above the hole's mouth to which the peg is moved first
_OVER_M = 0.03  # horizontal distance from the mouth's middle within which the peg is over the hole
_THERE_M = 0.03  # horizontal distance from its goal within which the hand has arrived
_NEAR_M = 0.06  # distance from the hole's middle within which the authors call it a success
_PEG_M = 0.02  # half of its length
_HOLE_M = 0.025  # half of its width
_DEPTH_M = 0.05  # from the hole's middle to its mouth
_STEPS = 15  # the script needs 10
_ROPE = (*(f"rope{i}" for i in range(1, 6)), "peg")  # each hangs on the previous one
_BOX = tuple(f"box_{side}" for side in ("left", "right", "front", "back", "bottom"))


def insert() -> Task:
    parameters = [
        _rope_length(),
        dynamics("peg_mass", "body_mass", ("peg",), nominal=0.5, unit="kg"),
        lighting(),
        *colour("peg", ("peg",), (1, 0.8, 0.1)),
        *colour("box", _BOX, (0.75, 0.75, 0.75)),
    ]
    return arm_task(
        "rope_peg",
        parameters,
        _WORKSPACE_M,
        description="lower a peg that hangs on a rope into a hole",
        initialize=_initialize,
        reward=_reward,
        success=_success,
        near_success=_near_success,
        goal_steps=_STEPS,
        script=_script,
    )


def _rope_length() -> Parameter:
    return Parameter(
        name="rope_length",
        field="body_pos",
        objects=_ROPE,
        component=2,
        nominal=0.12,
        low=0.04,
        high=0.24,  # much longer ropes could not be lifted over the box
        unit="m",
        is_sum=True,
    )


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    """Put the arm always at the same place, with the rope nearly still."""
    start_arm(batch)
    swing = batch.model.joint("swing_x").qposadr[0]
    batch.qpos[:, swing : swing + 2] = rng.normal(0, _SWING_STD, (batch.nsim, 2))
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """Minus the length of the peg's way to the hole, m: first above it, then down."""
    peg, hole = place_of(batch, "peg"), place_of(batch, "hole")
    above = place_of(batch, "mouth") + _UP * _ABOVE_M
    detour = _distance(peg, above) + _distance(above, hole)
    return -np.where(_is_over(peg, batch), _distance(peg, hole), detour)


def _success(batch: Batch) -> np.ndarray:
    """The whole peg is in the hole, below its mouth."""
    hole, mouth = place_of(batch, "hole"), place_of(batch, "mouth")
    axis, offset = (mouth - hole) / _DEPTH_M, place_of(batch, "peg") - hole
    height = (offset * axis).sum(-1)
    beside = _distance(offset, height[:, None] * axis)
    return (height < _DEPTH_M - _PEG_M) & (beside < _HOLE_M)


def _near_success(batch: Batch) -> np.ndarray:
    """The peg is within 6 cm of the hole's middle, or over the hole."""
    return _is_near(batch) | _is_over(place_of(batch, "peg"), batch)


def _is_near(batch: Batch) -> np.ndarray:
    return _distance(place_of(batch, "peg"), place_of(batch, "hole")) < _NEAR_M


def _is_over(peg: np.ndarray, batch: Batch) -> np.ndarray:
    """(nsim,) bool: whether the peg is at the hole's mouth, seen from above."""
    offset = peg - place_of(batch, "mouth")
    return _distance(offset[:, :2], 0) < _OVER_M


def _distance(a: np.ndarray, b: np.ndarray | float) -> np.ndarray:
    return np.linalg.norm(a - b, axis=-1)


def _script(batch: Batch) -> np.ndarray:
    """Move the hand over the hole (not the peg, which swings), then lower the peg into it."""
    hand, peg = place_of(batch, "hand"), place_of(batch, "peg")
    rope = _UP * np.linalg.norm(hand - peg, axis=-1, keepdims=True)
    above = place_of(batch, "mouth") + _UP * _ABOVE_M + rope
    is_there = _distance((above - hand)[:, :2], 0) < _THERE_M
    down = _is_near(batch) | (is_there & _is_over(peg, batch))
    goal = np.where(down[:, None], place_of(batch, "hole") + rope, above)
    return towards(goal - hand)
