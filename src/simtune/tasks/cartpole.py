"""Cartpole, balance: keep a pole upright on a cart (dm_control's task, smooth reward)."""

import numpy as np
from dm_control.utils.rewards import tolerance
from mujoco.batch import Batch

from simtune.parameters import colour, dynamics
from simtune.tasks.batch_state import reset_to_default
from simtune.tasks.suite import load_suite_spec, suite_task, untextured_model
from simtune.tasks.task import Task

_MAX_POSITION_M = 0.1  # initial positions are uniform within these, velocities are normal
_MAX_ANGLE_RAD = 0.034
_VELOCITY_STD = 0.01  # m/s and rad/s


def balance() -> Task:
    model = untextured_model(load_suite_spec("cartpole"))
    pole_mass_kg = float(model.body("pole_1").mass[0])
    gain = float(model.actuator("slide").gainprm[0])
    parameters = [
        dynamics("pole_mass", "body_mass", ("pole_1",), nominal=pole_mass_kg, unit="kg"),
        dynamics(
            "actuator_gain", "actuator_gainprm", ("slide",), component=0, nominal=gain, unit="1"
        ),
        *colour("body", ("cart", "pole_1"), (0.7, 0.5, 0.3)),
        *colour("ground", ("floor",), (1, 1, 1)),
    ]
    return suite_task(
        "cartpole",
        parameters,
        description="keep the pole on the cart upright",
        camera="fixed",
        encoders=("slider",),
        control_timestep_s=0.01,
        action_repeat=8,
        initialize=_initialize,
        reward=_reward,
        policy_steps=48_000,
    )


def _initialize(batch: Batch, rng: np.random.Generator) -> None:
    """Draw states with the pole nearly upright and nearly at rest."""
    high = np.array([_MAX_POSITION_M, _MAX_ANGLE_RAD])
    reset_to_default(batch)
    batch.qpos[:] = rng.uniform(-high, high, batch.qpos.shape)
    batch.qvel[:] = rng.normal(0, _VELOCITY_STD, batch.qvel.shape)
    batch.forward()


def _reward(batch: Batch) -> np.ndarray:
    """High for an upright pole, and less so for the middle, small controls and a still pole."""
    position, angle = batch.qpos.T
    upright = (np.cos(angle) + 1) / 2
    centered = (1 + tolerance(position, margin=2)) / 2
    small_control = tolerance(batch.ctrl[:, 0], margin=1, value_at_margin=0, sigmoid="quadratic")
    small_velocity = (1 + tolerance(batch.qvel[:, 1], margin=5)) / 2
    return upright * (4 + small_control) / 5 * small_velocity * centered
