"""Lengths far beyond a model's own: pixels or mm where metres are meant."""

from collections.abc import Mapping, Sequence

import numpy as np

from simtune.checking.doubt import Doubt, grouped
from simtune.checking.mistakes.joint_ranges import USUAL
from simtune.checking.servos.commands import commanded_spans
from simtune.observation import JointSensor, by_column
from simtune.parameters.joint_types import SLIDE
from simtune.simulation import Simulator

_FAR_IN_EXTENTS = 50.0  # of a model: farther than robots drive, and pixels or mm are more


def far_beyond_model(
    simulator: Simulator,
    actions: Sequence[np.ndarray],
    sensors: Sequence[JointSensor] = (),
    values: np.ndarray | None = None,
) -> list[str]:
    """On slides that are commanded, or without a servo read, far beyond the model.

    `actions`: (T, A) of episodes; `values`: (E, T + 1, D) readings of the sensors.
    """
    model, commanded = simulator.model, commanded_spans(simulator, actions)
    read = {} if values is None else _read(sensors, values)
    found = []
    for joint in range(model.njnt):
        name = model.joint(joint).name
        is_slide = model.jnt_type[joint] == SLIDE
        # Readings of a joint with a servo are compared with its commands, which tell more
        span = commanded.get(name, read.get(name, 0.0))
        if is_slide and span > _FAR_IN_EXTENTS * model.stat.extent:
            says = (
                f"{_says(name, commanded, read)}, in a model {model.stat.extent:.2g} m across: are "
                "these pixels or mm? Give [actions], the sensor or both a gain, see "
                "docs/tuning-file.md"
            )
            found.append(Doubt(says, "length", name))
    return grouped(found)


def _says(name: str, commanded: Mapping[str, float], read: Mapping[str, float]) -> str:
    by = [
        f"{does} over {spans[name]:.3g} m"
        for does, spans in (("is commanded", commanded), ("reads", read))
        if name in spans
    ]
    return f"{name} {' and '.join(by)}"


def _read(sensors: Sequence[JointSensor], values: np.ndarray) -> dict[str, float]:
    """{joint: how far its (E, T + 1, D) readings are apart}, of positions."""
    found = {}
    for sensor, column, read in by_column(sensors, values):
        known = read[np.isfinite(read)]
        if sensor.is_position and len(known):
            found[sensor.joints[column]] = float(np.ptp(np.quantile(known, USUAL)))
    return found
