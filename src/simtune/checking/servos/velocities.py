"""Velocities where positions are declared."""

from dataclasses import replace

import numpy as np
from scipy.signal import detrend

from simtune.checking.doubt import Doubt
from simtune.checking.servos.fit import ServoResponse, delay_of
from simtune.checking.servos.following import Following, Watched, follows
from simtune.fit.readings.readings import filled

VELOCITIES = 'are these velocities? give the sensor quantity = "velocity"'
_MIN_CORRELATION_GAIN = 0.1  # of readings with commanded speeds over that of their changes
_SLOPE_BOUNDS = (0.5, 1.25)  # of integrals against commands: contacts shorten a joint's way


def are_velocities(joint: Watched, servo: ServoResponse, following: Following) -> Doubt | None:
    """A doubt if readings of positions follow a command as velocities clearly better."""
    if joint.positions:
        own = follows(joint._replace(measured=joint.positions), servo)
        is_better = (
            own.is_clear
            and abs(own.correlation) >= abs(following.correlation) + _MIN_CORRELATION_GAIN
        )
        what = "reads what follows its commanded speed"
    elif not joint.is_speed:
        own = _of_integrals(joint, servo)
        is_alike = _SLOPE_BOUNDS[0] < abs(own.slope) < _SLOPE_BOUNDS[1]
        is_better = is_alike and own.leaves_less_than(following)
        what = "reads that whose integral follows its command"
    else:
        return None
    says = f"{joint.name} {what} (correlation {own.correlation:.2f}): {VELOCITIES}"
    return Doubt(says, VELOCITIES, joint.name) if is_better else None


def _of_integrals(joint: Watched, servo: ServoResponse) -> Following:
    """How integrals of readings follow commands, but for a line in each episode.

    Such a line is what a velocity's offset adds, and all that the integral of a joint that rests
    has.
    """
    long = [e for e, read in enumerate(joint.measured) if np.isfinite(read).any()]
    commands = [detrend(joint.commands[e]) for e in long]
    measured = [_integral(joint.measured[e], joint.step_s) for e in long]
    if not long:
        return Following(0.0, 0.0, 0.0)
    lag = delay_of(commands, measured, joint.step_s)
    speed = joint._replace(commands=commands, measured=measured)
    return follows(speed, replace(servo, lag_steps=lag))


def _integral(read: np.ndarray, step_s: float) -> np.ndarray:
    known = filled(read[None, :, None])[0, :, 0]
    return detrend(np.cumsum(known) * step_s)
