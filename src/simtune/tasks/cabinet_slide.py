"""Cabinet slide: an arm pushes the lid of a cabinet open by its handle.

After Du et al. 2021 (arXiv:2104.07662, Sec. V), with our own scene. Two differences: the arm starts
at the top of its workspace (z 1.02 m; theirs starts 5 cm higher); and the task is done when the lid
is within a centimetre of the end of its travel, since their goal lies beyond that end. It has to be
so after 27 of 60 steps, half as many again as the script needs, and to stay so.
"""

import numpy as np
from mujoco.batch import Batch

from simtune.parameters import colour, dynamics
from simtune.tasks.task import Task
from simtune.tasks.xarm7.scene import arm_task, lighting, place_of, start_arm, towards

_WORKSPACE_M = [[-0.25, 0.35], [0.196, 0.546], [0.82, 1.02]]  # of the hand
_OPEN_X_M = -0.075  # of the handle
_DONE_M = 0.01  # distance from fully open
_STEPS = 27  # the script needs 18
_BESIDE_M = np.array([0.05, 0.0, 0.04])  # from the handle to where the tool starts to push
_PUSH_M = 0.015  # per step; small, so that the lid's lag reveals its friction
_CLEAR_M = 0.1  # height at which the tool passes over the handle
_CABINET = tuple(f"cabinet_{side}" for side in ("left", "right", "front", "back"))


def slide() -> Task:
    parameters = [
        dynamics("cabinet_friction", "dof_frictionloss", ("lid",), nominal=5.0, unit="N"),
        lighting(),
        *colour("cabinet", (*_CABINET, "lid"), (0.84, 0.77, 0.7)),
        *colour("table", ("table",), (1, 1, 1)),
    ]
    return arm_task(
        "cabinet_slide",
        parameters,
        _WORKSPACE_M,
        description="slide a cabinet's lid open",
        initialize=_initialize,
        reward=_reward,
        success=_success,
        goal_steps=_STEPS,
        script=_script,
    )


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    """Set the same state every time."""
    start_arm(batch)
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """Minus the distances from the hand to the handle and from the handle to its goal, m."""
    hand, handle = place_of(batch, "hand"), place_of(batch, "handle")
    return -np.linalg.norm(hand - handle, axis=-1) - np.abs(handle[:, 0] - _OPEN_X_M)


def _success(batch: Batch) -> np.ndarray:
    return place_of(batch, "handle")[:, 0] < _OPEN_X_M + _DONE_M


def _script(batch: Batch) -> np.ndarray:
    """Move above the place beside the handle, then down, then push until the lid is open."""
    hand, handle = place_of(batch, "hand"), place_of(batch, "handle")
    way = handle + _BESIDE_M - hand
    is_beside = (np.abs(way[:, 0]) < 0.03) & (np.abs(way[:, 1]) < 0.02)
    is_down = np.abs(way[:, 2]) < 0.015
    way[~is_beside, 2] += _CLEAR_M
    left = _OPEN_X_M - handle[:, 0]
    way[:, 0] = np.where(is_beside & is_down, np.clip(left, -_PUSH_M, 0), way[:, 0])
    return towards(way)
