"""Readings of hinges whose size is that of degrees, where no simulated world endures them."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.columns import cut
from simtune.observation import JointSensor, by_column
from simtune.units import GAIN_OF_DEGREES

_FAR_IN_RANGES = 3.0  # no encoder's zero is so far off
_TURN_RAD = 2 * np.pi  # either way, of hinges without limits
_MOST_NAMED = 3
_SLACK_SHARE = 0.1  # of a range: limits are soft, and zeros a little off


def like_degrees(
    model: mujoco.MjModel, sensors: Sequence[JointSensor], values: np.ndarray
) -> list[str]:
    """A sentence on (E, T + 1, D) readings; none if none looks like degrees."""
    sizes = {
        sensor.joints[column]: float(np.nanmax(np.abs(read)))
        for sensor, column, read in by_column(sensors, values)
        if sensor.unit == "rad" and np.isfinite(read).any()
        if _is_too_far(model, sensor.joints[column], read)
    }
    if not sizes:
        return []
    told = cut([f"{joint} {size:.4g}" for joint, size in sizes.items()], _MOST_NAMED)
    return [
        f"the largest readings in rad are {told}, far beyond what these hinges can turn: are they "
        'in degrees? Then write unit = "deg" in [[sensors]], and, if actions are in degrees as '
        f'well, mapping = "scaled" and gain = {GAIN_OF_DEGREES} in [actions]'
    ]


def _is_too_far(model: mujoco.MjModel, joint: str, read: np.ndarray) -> bool:
    """Whether a hinge cannot turn as far as readings in rad say, but in degrees it can."""
    limits = model.joint(joint)
    low, high = limits.range if limits.limited[0] else (-_TURN_RAD, _TURN_RAD)
    least, most = np.nanmin(read), np.nanmax(read)
    slack, (begins, ends) = _SLACK_SHARE * (high - low), np.deg2rad([least, most])
    is_far = max(-least, most) > _FAR_IN_RANGES * max(-low, high)
    return bool(is_far and begins > low - slack and ends < high + slack)
