"""Finger, spin: a two-link finger flicks a free spinner (dm_control's task)."""

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters import colour, dynamics
from simtune.tasks.batch_state import draw_without_contact, randomize_joints, reset_to_default
from simtune.tasks.suite import load_suite_spec, suite_task, untextured_model
from simtune.tasks.task import Task

_SPIN_SPEED_RAD_S = 15.0
_SPINNER_DAMPING = 0.03  # N·m·s/rad; the model file has the value of another task


def spin() -> Task:
    model = untextured_model(_load_spec())
    spinner_mass_kg = float(model.body("spinner").mass[0])
    damping = float(model.joint("proximal").damping[0])
    parameters = [
        dynamics("spinner_mass", "body_mass", ("spinner",), nominal=spinner_mass_kg, unit="kg"),
        dynamics(
            "proximal_damping", "dof_damping", ("proximal",), nominal=damping, unit="N·m·s/rad"
        ),
        *colour("finger", ("proximal", "distal"), (0.7, 0.5, 0.3)),
        *colour("spinner", ("cap1", "cap2"), (0.7, 0.5, 0.3)),
        *colour("ground", ("ground",), (1, 1, 1)),
    ]
    return suite_task(
        "finger",
        parameters,
        _load_spec,
        description="flick a free spinner so that it turns faster than 15 rad/s",
        camera="cam0",
        encoders=("proximal", "distal"),
        control_timestep_s=0.02,
        action_repeat=2,
        initialize=_initialize,
        reward=_reward,
        policy_steps=160_000,
        symmetric_hinges={"hinge": 2},  # the spinner's caps are alike
    )


def _load_spec() -> mujoco.MjSpec:
    """The suite's finger as in its spin task: low spinner damping, and the target is invisible."""
    spec = load_suite_spec("finger")
    spec.joint("hinge").damping[0] = _SPINNER_DAMPING
    for name in ("target", "tip"):
        spec.site(name).rgba[3] = 0
    return spec


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    """Draw angles of finger and spinner at which they do not touch."""
    reset_to_default(batch)
    draw_without_contact(batch, lambda ids: randomize_joints(batch, rng, ids))
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """1 while the spinner turns fast enough in the negative direction."""
    hinge = batch.model.joint("hinge").dofadr[0]
    return (batch.qvel[:, hinge] <= -_SPIN_SPEED_RAD_S).astype(float)
