"""Encoders that read the same all the time, of joints that motors push."""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.checking.doubt import Doubt, grouped
from simtune.fit import Readings
from simtune.observation import JointSensor, by_column
from simtune.simulation import Simulator
from simtune.simulation.servos import actuator_name, motors

_MIN_READ_S = 1.0  # a joint may rest for less
_CHANGED_SHARE = 0.1  # of an action's range
_AT_LIMIT_SHARE = 0.02  # of a joint's range


def dead_encoders(
    readings: Readings, simulator: Simulator, sensors: Sequence[JointSensor]
) -> list[str]:
    """On joints that read exactly the same, away from their limits, while actions of their motors
    change.
    """
    pushed, found = _pushed(readings.actions, simulator), []
    for sensor, column, read in by_column(sensors, readings.values):
        joint, known = sensor.joints[column], read[np.isfinite(read)]
        is_long = len(known) * simulator.step_s >= _MIN_READ_S
        if joint not in pushed or not is_long or np.ptp(known) > 0:
            continue
        if not sensor.is_position or not _is_at_limit(simulator.model, joint, known[0]):
            says = f"{joint} reads {known[0]:.4g} {sensor.unit} all the time, while the actions of "
            asks = "is the sensor stuck, another column meant, or the motor off?"
            found.append(Doubt(f"{says}{pushed[joint]} change: {asks}", asks, joint))
    return grouped(found)


def _is_at_limit(model: mujoco.MjModel, name: str, place: float) -> bool:
    """Whether a joint may rest there however it is pushed, such as a gripper that is closed."""
    joint = model.joint(name)
    near = _AT_LIMIT_SHARE * np.ptp(joint.range)
    return bool(joint.limited[0]) and not joint.range[0] + near < place < joint.range[1] - near


def _pushed(actions: np.ndarray, simulator: Simulator) -> dict[str, str]:
    """{joint: its motor}, of motors whose (E, T, A) actions change."""
    model, names = simulator.model, simulator.action_mapping.names
    mapping = simulator.action_mapping
    enough = np.where(mapping.is_limited, _CHANGED_SHARE * np.ptp(mapping.range, axis=1), 0.0)
    changed = zip(names, np.ptp(actions, axis=(0, 1)) > enough, strict=True)
    changes = {name for name, does in changed if does}
    of_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT.value
    return {
        model.joint(model.actuator_trnid[i, 0]).name: name
        for i in np.flatnonzero(motors(model) & of_joint).tolist()
        if (name := actuator_name(model, i)) in changes
    }
