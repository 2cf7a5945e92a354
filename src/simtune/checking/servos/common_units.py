"""A wrong unit that all joints of a sensor share: told by how far they move, before all else.

In a unit that is 57 or 1000 times too large or too small, a joint looks as if it were switched off,
or another one's. The unit alone explains that.
"""

from collections.abc import Sequence

import numpy as np

from simtune.checking.servos.fit import usual_travel
from simtune.checking.servos.following import Watched
from simtune.observation import JointSensor
from simtune.units import OTHER_UNITS

_FEWEST_JOINTS = 3  # of fewer, each one is looked at alone
_USUAL_SHARES = (0.4, 1.25)  # of what is commanded: the median, in the right unit
_LEAST_SHARE, _MOST_SHARE = 0.1, 3.0  # of every joint


def common_scales(
    joints: Sequence[Watched | None], sensors: Sequence[JointSensor]
) -> list[float | None]:
    """For each of D readings how many times too large its sensor's are; None unless all say so."""
    found: list[float | None] = []
    for sensor in sensors:
        own = joints[len(found) : len(found) + sensor.size]
        found += [_common_scale([joint for joint in own if joint])] * sensor.size
    return found


def _common_scale(joints: Sequence[Watched]) -> float | None:
    """Of one sensor's joints that servos move."""
    units = {joint.unit for joint in joints}
    if len(joints) < _FEWEST_JOINTS or len(units) > 1 or not units <= OTHER_UNITS.keys():
        return None
    asked = np.array([usual_travel(joint.commands) for joint in joints])
    moved = np.array([usual_travel(joint.measured) for joint in joints])
    asks = np.isfinite(moved) & (asked > 0)
    if asks.sum() < _FEWEST_JOINTS:
        return None
    factor = OTHER_UNITS[units.pop()][0]
    for scale in (factor, 1 / factor):
        shares = moved[asks] / asked[asks] / scale
        is_usual = _USUAL_SHARES[0] < np.median(shares) < _USUAL_SHARES[1]
        if is_usual and shares.min() > _LEAST_SHARE and shares.max() < _MOST_SHARE:
            return scale
    return None
