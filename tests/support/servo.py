"""A cartpole whose cart is displaced from where it is, as a robot is that is moved by joints."""

import mujoco

from simtune.tasks import load_task


def cartpole_with_servo(**servo: float) -> mujoco.MjSpec:
    """`servo`: of `set_to_position`."""
    spec = load_task("cartpole").load_spec()
    motor = spec.actuator("slide")
    motor.set_to_position(kp=10, **servo)
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
    return spec
