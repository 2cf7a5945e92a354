"""Cheetah, run: a planar cheetah runs as fast as possible, up to 10 m/s (dm_control's task)."""

import mujoco
import numpy as np
from dm_control.utils.rewards import tolerance
from mujoco.batch import Batch

from simtune.parameters import colour, dynamics
from simtune.tasks.batch_state import computed, reset_to_default
from simtune.tasks.suite import load_suite_spec, suite_task, untextured_model
from simtune.tasks.task import Task

_RUN_SPEED_M_S = 10.0
_TOTAL_MASS_KG = 14.0
_STABILISING_STEPS = 200  # physics steps before the episode, to fall onto the ground
_BODIES = ("torso", "bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot")
_ENCODERS = _BODIES[1:]  # joints have the names of the bodies that they move
_GEOMS = (*_BODIES, "head")  # each body has a geom of the same name


def run() -> Task:
    parameters = [
        dynamics("mass", "body_mass", _BODIES),
        *colour("body", _GEOMS, (0.7, 0.5, 0.3)),
        *colour("ground", ("ground",), (1, 1, 1)),
    ]
    return suite_task(
        "cheetah",
        parameters,
        _load_spec,
        description="run forward as fast as 10 m/s",
        camera="side",
        encoders=_ENCODERS,
        control_timestep_s=0.01,
        action_repeat=4,
        initialize=_initialize,
        reward=_reward,
        policy_steps=160_000,
        free_joints=("rootx",),
    )


def _load_spec() -> mujoco.MjSpec:
    """The suite's cheetah with its geoms' densities scaled to the total mass.

    The model file uses the compiler's settotalmass instead, which is deprecated and would undo a
    tuned mass in an exported model.
    """
    spec = load_suite_spec("cheetah")
    spec.compiler.settotalmass = -1
    ratio = _TOTAL_MASS_KG / untextured_model(spec).body_mass.sum()
    for geom in spec.geoms:
        geom.density *= ratio
    return spec


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    """Draw limited joints, then let the cheetah fall until it rests approximately."""
    limited = batch.model.jnt_limited == 1
    low, high = batch.model.jnt_range[limited].T
    reset_to_default(batch)
    batch.qpos[:, limited] = rng.uniform(low, high, (batch.nsim, limited.sum()))
    batch.step(nstep=_STABILISING_STEPS)
    batch.time[:] = 0
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    speed = batch.model.sensor("torso_subtreelinvel").adr[0]  # its first component is along x
    moving = tolerance(
        computed(batch, "sensordata")[:, speed],
        bounds=(_RUN_SPEED_M_S, np.inf),
        margin=_RUN_SPEED_M_S,
        value_at_margin=0,
        sigmoid="linear",
    )
    return np.asarray(moving)
