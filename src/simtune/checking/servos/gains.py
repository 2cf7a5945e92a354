"""Lines for a tuning file that mend a sensor's unit and signs together."""

from collections.abc import Sequence

import numpy as np

from simtune.observation import JointSensor


def gains_to_write(sensors: Sequence[JointSensor], misread_by: Sequence[float | None]) -> list[str]:
    """Of D readings: a sentence for each sensor with a reversed sign, which no unit mends.

    Readings of which nothing is known are taken to be in the unit of the same sensor's others.
    """
    found, ends = [], np.cumsum([0, *(sensor.size for sensor in sensors)])
    for sensor, start, end in zip(sensors, ends, ends[1:], strict=False):
        known = [factor for factor in misread_by[start:end] if factor is not None]
        sizes = {abs(factor) for factor in known}
        is_unclear = len(known) < sensor.size and len(sizes) > 1
        if all(factor > 0 for factor in known) or is_unclear or sensor.shift.any():
            continue
        factors = np.array([max(sizes) if f is None else f for f in misread_by[start:end]])
        gains = [f"{gain:.4g}" for gain in 1 / (sensor.factor * factors)]
        line = gains[0] if len(set(gains)) == 1 else f"[{', '.join(gains)}]"
        found.append(
            f"if it is not the actions, write gain = {line} for sensor {sensor.name}, in place of "
            "its unit or gain"
        )
    return found
