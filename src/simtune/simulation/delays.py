"""Delayed actuators: what MuJoCo must know before it compiles a model.

MuJoCo keeps the controls of an actuator's last `nsample` steps and drives it by that of
`actuator_delay` seconds ago; before an episode's start they were 0, except for servos
(`held_controls`). It reads before it stores, so any delay is at least one step; 0 is none. Between
two steps it can

* hold the earlier one, but rounding errors of the time then decide whether a delay of whole steps
  is one step longer: measured, in up to three of four steps;
* interpolate: exact for whole steps, and in between each step has the same impulse as a control
  that is held from step to step and delayed as long. So this is used.

The Runge-Kutta integrator looks ahead within a step: with it, interpolated controls come half a
step too early, for delays of two steps or more.
"""

import math

import mujoco

from simtune.parameters import ParameterSpace

_LINEAR = 1  # MjSpec's number for interpolation between two samples


def count_substeps(step_s: float, timestep_s: float) -> int:
    """Physics steps per policy step: as near to the model's timestep as whole numbers allow."""
    return max(1, round(step_s / timestep_s))


def remember_controls(spec: mujoco.MjSpec, space: ParameterSpace, step_s: float) -> None:
    """Give the actuators that `space` delays memory for the longest delay.

    `step_s`: of a policy step; it determines the length of a physics step.
    """
    # The model's own timestep, with which an exported one is played, may be shorter
    adapted_s = step_s / count_substeps(step_s, spec.option.timestep)
    timestep_s = min(adapted_s, spec.option.timestep)
    for parameter in space:
        if not parameter.is_delay:
            continue
        num_samples = math.ceil(parameter.high / timestep_s - 1e-6)
        for name in parameter.objects:
            if actuator := spec.actuator(name):  # ModelWriter reports unknown ones
                actuator.nsample = max(actuator.nsample, num_samples)
                actuator.interp = _LINEAR
