"""Which actions command the positions of endless joints."""

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.observation import JointSensor
from simtune.parameters.fields import OF_JOINTS
from simtune.parameters.joint_types import HINGE
from simtune.recordings import Turning
from simtune.simulation import ActionMapping
from simtune.simulation.servos import control_limits, joint_target, position_servos


def turnings_of(
    model: mujoco.MjModel, mapping: ActionMapping, sensors: Sequence[JointSensor]
) -> list[Turning]:
    """Actions that are targets of position servos on hinges without limits, if there are any."""
    servos = _endless_servos(model)
    if mapping.is_relative or not servos.size:
        return []
    num = len(mapping.names)
    controls = mapping.apply(Batch(model, num + 1), np.eye(num + 1, num, -1))  # of none, each
    found = []
    for servo in servos:
        control = model.actuator_ctrladr[servo]
        per_action = controls[1:, control] - controls[0, control]
        if np.count_nonzero(per_action) != 1:
            continue
        action, (shift, factor) = int(np.abs(per_action).argmax()), joint_target(model, servo)
        angle = shift + factor * controls[0, control]  # at an action of 0
        per_unit = factor * per_action[action]
        place = model.jnt_qposadr[model.actuator_trnid[servo, 0]]
        ends = np.array(control_limits(model, control)) - controls[0, control]
        low, high = np.sort(ends / per_action[action]).tolist()
        turning = _turning(action, angle, per_unit, place, sensors)
        found.append(turning._replace(low=low, high=high))
    return found


def _turning(
    action: int, angle: float, per_unit: float, place: int, sensors: Sequence[JointSensor]
) -> Turning:
    """Of an action that sends the joint at `place` in qpos to `angle` + `per_unit` · action rad."""
    period, column = 2 * np.pi / abs(per_unit), 0
    for sensor in sensors:
        if sensor.is_position and place in sensor.places:
            own = int(np.flatnonzero(sensor.places == place)[0])
            scale = 1 / (sensor.factor[own] * per_unit)
            known = 0.0 if sensor.offset is None else sensor.offset[own]
            at_0 = -sensor.shift[own] / sensor.factor[own] - known  # rad, at a reading of 0
            return Turning(action, period, column + own, scale, (at_0 - angle) / per_unit)
        column += sensor.size
    return Turning(action, period)


def _endless_servos(model: mujoco.MjModel) -> np.ndarray:
    """Ids of actuators."""
    joints = model.actuator_trnid[:, 0]
    of_joints = np.isin(model.actuator_trntype, OF_JOINTS) & (model.actuator_ctrlnum == 1)
    (ids,) = np.nonzero(of_joints & position_servos(model))
    is_endless = (model.jnt_type[joints[ids]] == HINGE) & (model.jnt_limited[joints[ids]] == 0)
    return ids[is_endless & (model.actuator_gear[model.actuator_outadr[ids], 0] != 0)]
