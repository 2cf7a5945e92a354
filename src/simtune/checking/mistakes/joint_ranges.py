"""Readings that span more than their joint can travel: of another unit, or another column."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.checking.doubt import Doubt, grouped
from simtune.observation import JointSensor, by_column

WIDER = 1.25  # than the joint's range: limits are soft
# Nothing that a joint strikes makes it so; less is left to its commands, which tell more
CERTAINLY_WIDER = 3.0
USUAL = (0.01, 0.99)  # quantiles of readings


def beyond_ranges(
    model: mujoco.MjModel,
    sensors: Sequence[JointSensor],
    values: np.ndarray,
    wider: Sequence[float],
) -> list[str]:
    """On (E, T + 1, D) readings that span `wider` (D,) times a joint's range, or more.

    An encoder's zero may be anywhere.
    """
    found = []
    for (sensor, column, read), factor in zip(by_column(sensors, values), wider, strict=True):
        joint, known = sensor.joints[column], read[np.isfinite(read)]
        limits = model.joint(joint)
        if not sensor.is_position or not limits.limited[0] or not len(known):
            continue
        (low, high), (least, most) = limits.range, np.quantile(known, USUAL)
        if most - least > factor * (high - low):
            says = (
                f"{joint} reads {least:.3g} to {most:.3g} {sensor.unit}, farther apart than the "
                f"model's joint can move, {low:.3g} to {high:.3g}: are its unit and column right?"
            )
            found.append(Doubt(says, "range", joint))
    return grouped(found)
