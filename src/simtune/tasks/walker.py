"""Walker, walk: a planar two-legged walker at 1 m/s (dm_control's task)."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters import ParameterSpace, colour, dynamics
from simtune.tasks.batch_state import computed, randomize_joints, reset_to_default
from simtune.tasks.rewards import tolerance
from simtune.tasks.suite_model import load_suite_spec
from simtune.tasks.task import Task

_STAND_HEIGHT_M = 1.2  # of the torso
_WALK_SPEED_M_S = 1.0
# Each body has one geom, of the same name.
_BODIES = (
    "torso",
    "right_thigh",
    "right_leg",
    "right_foot",
    "left_thigh",
    "left_leg",
    "left_foot",
)


def walk() -> Task:
    parameters = [
        dynamics("mass", "body_mass", _BODIES),
        *colour("body", _BODIES, (0.7, 0.5, 0.3)),
        *colour("ground", ("floor",), (1, 1, 1)),
    ]
    return Task(
        name="walker",
        description="walk upright on two legs at 1 m/s",
        load_spec=_load_spec,
        parameters=ParameterSpace(parameters, where="walker"),
        camera="side",
        control_timestep_s=0.025,
        action_repeat=2,
        initialize=_initialize,
        reward=_reward,
        policy_steps=160_000,
        free_joints=("rootx",),
    )


def _load_spec() -> mujoco.MjSpec:
    return load_suite_spec("walker.xml")


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    reset_to_default(batch)
    randomize_joints(batch, rng, np.arange(batch.nsim))
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """Standing, upright, and moving forward."""
    torso = batch.model.body("torso").id
    speed = batch.model.sensor("torso_subtreelinvel").adr[0]  # its first component is along x
    standing = tolerance(
        computed(batch, "xpos")[:, torso, 2],
        low=_STAND_HEIGHT_M,
        high=np.inf,
        margin=_STAND_HEIGHT_M / 2,
    )
    upright = (1 + computed(batch, "xmat")[:, torso].reshape(-1, 3, 3)[:, 2, 2]) / 2
    moving = tolerance(
        computed(batch, "sensordata")[:, speed],
        low=_WALK_SPEED_M_S,
        high=np.inf,
        margin=_WALK_SPEED_M_S / 2,
        value_at_margin=0.5,
        shape="linear",
    )
    return (3 * standing + upright) / 4 * (5 * moving + 1) / 6
