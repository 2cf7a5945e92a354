"""Walker, walk: a planar two-legged walker at 1 m/s (dm_control's task)."""

import numpy as np
from dm_control.utils.rewards import tolerance
from mujoco.batch import Batch

from simtune.parameters import colour, dynamics
from simtune.tasks.batch_state import computed, randomize_joints, reset_to_default
from simtune.tasks.suite import suite_task
from simtune.tasks.task import Task

_STAND_HEIGHT_M = 1.2  # of the torso
_WALK_SPEED_M_S = 1.0
# Each body has one geom, of the same name
_LEGS = [f"{side}_{part}" for side in ("right", "left") for part in ("thigh", "leg", "foot")]
_BODIES = ("torso", *_LEGS)
_ENCODERS = tuple(f"{side}_{j}" for side in ("right", "left") for j in ("hip", "knee", "ankle"))


def walk() -> Task:
    parameters = [
        dynamics("mass", "body_mass", _BODIES),
        *colour("body", _BODIES, (0.7, 0.5, 0.3)),
        *colour("ground", ("floor",), (1, 1, 1)),
    ]
    return suite_task(
        "walker",
        parameters,
        description="walk upright on two legs at 1 m/s",
        camera="side",
        encoders=_ENCODERS,
        control_timestep_s=0.025,
        action_repeat=2,
        initialize=_initialize,
        reward=_reward,
        policy_steps=160_000,
        free_joints=("rootx",),
    )


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    reset_to_default(batch)
    randomize_joints(batch, rng, np.arange(batch.nsim))
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """High for standing, being upright, and moving forward."""
    torso = batch.model.body("torso").id
    speed = batch.model.sensor("torso_subtreelinvel").adr[0]  # its first component is along x
    standing = tolerance(
        computed(batch, "xpos")[:, torso, 2],
        bounds=(_STAND_HEIGHT_M, np.inf),
        margin=_STAND_HEIGHT_M / 2,
    )
    upright = (1 + computed(batch, "xmat")[:, torso].reshape(-1, 3, 3)[:, 2, 2]) / 2
    moving = tolerance(
        computed(batch, "sensordata")[:, speed],
        bounds=(_WALK_SPEED_M_S, np.inf),
        margin=_WALK_SPEED_M_S / 2,
        value_at_margin=0.5,
        sigmoid="linear",
    )
    return (3 * standing + upright) / 4 * (5 * moving + 1) / 6
