"""Limits that the xArm's controller enforces itself: set, and read back."""

import math
import time
from typing import Any

import numpy as np

from simtune.errors import RobotError
from simtune.robot.limits import Limits

REPORTED_WITHIN_S = 2.0  # that were set, by the controller


def limit_controller(arm: Any, limits: Limits, collision_sensitivity: int) -> None:
    """Set reduced mode with speed and boundary, the fence, and the collision sensitivity.

    Raises RobotError if the controller refuses a limit, or then reports another one.
    """
    boundary = _boundary(limits)
    steps = {
        "maximum speed": arm.set_reduced_max_tcp_speed(limits.speed),
        "TCP boundary": arm.set_reduced_tcp_boundary(boundary),
        "reduced mode": arm.set_reduced_mode(True),
        "fence": arm.set_fence_mode(True),
        "self-collision detection": arm.set_self_collision_detection(True),
        "collision sensitivity": arm.set_collision_sensitivity(collision_sensitivity),
    }
    for what, answer in steps.items():
        code = answer[0] if isinstance(answer, list) else answer
        if code != 0:
            raise RobotError(f"the controller does not set its {what} (code {code})")
    check_controller(arm, limits, collision_sensitivity)


def check_controller(arm: Any, limits: Limits, collision_sensitivity: int) -> None:
    """Raises RobotError if these limits are not in force."""
    code, states = arm.get_reduced_states()
    if code != 0 or len(states) < 7:
        raise RobotError(f"the controller does not tell its limits (code {code})")
    is_reduced, boundary, speed, _, _, is_fenced, _ = states[:7]
    expected = {
        "reduced mode": (1, is_reduced),
        "TCP boundary": (_boundary(limits), list(boundary)),
        "maximum speed": (np.float32(limits.speed), np.float32(speed)),
        "fence": (1, is_fenced),
    }
    deadline_s = time.monotonic() + REPORTED_WITHIN_S
    while arm.collision_sensitivity != collision_sensitivity and time.monotonic() < deadline_s:
        time.sleep(0.02)  # only reports have it, and they come five times a second
    expected["collision sensitivity"] = (collision_sensitivity, arm.collision_sensitivity)
    for what, (wanted, found) in expected.items():
        if found != wanted:
            raise RobotError(
                f"the controller's {what} is {found} after {wanted} was set: nothing may move"
            )


def _boundary(limits: Limits) -> list[int]:
    """The boundary in the controller's format: highest and lowest x, y and z, in whole mm.

    It includes the tolerance, so that an arm sent to the edge is not stopped.
    """
    boundary = []
    for low, high in zip(limits.low, limits.high, strict=True):
        boundary += [math.ceil(high + limits.tolerance), math.floor(low - limits.tolerance)]
    return boundary
