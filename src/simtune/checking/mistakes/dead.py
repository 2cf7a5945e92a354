"""Encoders that read the same all the time, of joints that motors push."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.checking.servos.doubt import Doubt, grouped
from simtune.fit import Readings
from simtune.observation import JointSensor, by_column
from simtune.simulation import Simulator
from simtune.simulation.servos import actuator_name, motors

_FEWEST_S = 1.0  # of readings: a joint may rest for less


def dead_encoders(
    readings: Readings, simulator: Simulator, sensors: Sequence[JointSensor]
) -> list[str]:
    """On joints that read exactly the same while actions of their motors change."""
    pushed, found = _pushed(readings.actions, simulator), []
    for sensor, column, its in by_column(sensors, readings.values):
        joint, known = sensor.joints[column], its[np.isfinite(its)]
        is_long = len(known) * simulator.step_s >= _FEWEST_S
        if joint in pushed and is_long and np.ptp(known) == 0:
            says = f"{joint} reads {known[0]:.4g} {sensor.unit} all the time, while the actions of "
            asks = "is the sensor stuck, another column meant, or the motor off?"
            found.append(Doubt(f"{says}{pushed[joint]} change: {asks}", asks, joint))
    return grouped(found)


def _pushed(actions: np.ndarray, simulator: Simulator) -> dict[str, str]:
    """{joint: its motor}, of motors whose (E, T, A) actions change."""
    model, names = simulator.model, simulator.action_mapping.names
    changes = {name for name, its in zip(names, actions.T, strict=True) if np.ptp(its) > 0}
    of_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT.value
    return {
        model.joint(model.actuator_trnid[i, 0]).name: name
        for i in np.flatnonzero(motors(model) & of_joint).tolist()
        if (name := actuator_name(model, i)) in changes
    }
