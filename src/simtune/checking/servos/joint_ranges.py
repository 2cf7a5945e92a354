"""Readings that span more than their joint can travel: of another unit, or another column."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.observation import JointSensor

_WIDER = 1.25  # than the joint's range: limits are soft
_USUAL = (0.01, 0.99)  # quantiles of readings


def beyond_ranges(
    model: mujoco.MjModel,
    sensors: Sequence[JointSensor],
    values: np.ndarray,
    has_servo: Sequence[bool],
) -> list[str]:
    """On (E, T + 1, D) readings of joints without a servo; an encoder's zero may be anywhere.

    Those of a servo are compared with what is commanded, which tells more.
    """
    columns = [(sensor, joint) for sensor in sensors for joint in sensor.joints]
    found = []
    for (sensor, joint), read, is_commanded in zip(
        columns, np.moveaxis(values, -1, 0), has_servo, strict=True
    ):
        limits, known = model.joint(joint), read[np.isfinite(read)]
        if is_commanded or sensor.is_velocity or not limits.limited[0] or not len(known):
            continue
        (low, high), (least, most) = limits.range, np.quantile(known, _USUAL)
        if most - least > _WIDER * (high - low):
            found.append(
                f"{joint} reads {least:.3g} to {most:.3g} {sensor.unit}, farther apart than the "
                f"model's joint can move, {low:.3g} to {high:.3g}: are its unit and column right?"
            )
    return found
