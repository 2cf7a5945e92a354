"""Ball in cup, catch: swing a ball on a string into the cup (dm_control's task)."""

import numpy as np
from mujoco.batch import Batch

from simtune.parameters import colour, dynamics
from simtune.tasks.batch_state import computed, draw_without_contact, reset_to_default
from simtune.tasks.suite import load_suite_spec, suite_task, untextured_model
from simtune.tasks.task import Task

_BALL_X_M = (-0.2, 0.2)  # initial positions, relative to the ball's position at rest
_BALL_Z_M = (0.2, 0.5)
_CUP_GEOMS = tuple(f"cup_part_{i}" for i in range(5))


def catch() -> Task:
    model = untextured_model(load_suite_spec("ball_in_cup"))
    ball_mass_kg = float(model.body("ball").mass[0])
    parameters = [
        dynamics("ball_mass", "body_mass", ("ball",), nominal=ball_mass_kg, unit="kg"),
        *colour("cup", _CUP_GEOMS, (0.7, 0.5, 0.3)),
        *colour("ball", ("ball",), (0.7, 0.4, 0.2)),
        *colour("ground", ("ground",), (1, 1, 1)),
    ]
    return suite_task(
        "ball_in_cup",
        parameters,
        description="swing a ball on a string into the cup",
        camera="cam0",
        encoders=("cup_x", "cup_z"),
        control_timestep_s=0.02,
        action_repeat=4,
        initialize=_initialize,
        reward=_reward,
        policy_steps=96_000,
    )


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    """Draw positions of the ball above the ground at which it does not touch the cup."""
    ball_x = batch.model.joint("ball_x").qposadr[0]
    ball_z = batch.model.joint("ball_z").qposadr[0]

    def draw(ids: np.ndarray) -> None:
        batch.qpos[ids, ball_x] = rng.uniform(*_BALL_X_M, len(ids))
        batch.qpos[ids, ball_z] = rng.uniform(*_BALL_Z_M, len(ids))

    reset_to_default(batch)
    draw_without_contact(batch, draw)
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """1 while the whole ball is within the cup's target box, seen from the front."""
    model = batch.model
    ball, target = model.body("ball").id, model.site("target").id
    offset = computed(batch, "site_xpos")[:, target] - computed(batch, "xpos")[:, ball]
    room = model.site_size[target] - model.geom("ball").size[0]
    return (np.abs(offset) < room)[:, [0, 2]].all(axis=1).astype(float)
