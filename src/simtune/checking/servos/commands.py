"""Servo commands of actions: controls, as angles, lengths or speeds of joints."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.fit.readings.readings import filled
from simtune.observation import JointSensor, columns_of
from simtune.simulation import Simulator
from simtune.simulation.servos import (
    actuator_name,
    are_commanded,
    control_limits,
    joint_target,
    position_servos,
    velocity_servos,
)
from simtune.trajectory import Trajectory

_CHUNK = 256  # worlds whose controls are computed at once
_JOINT, _TENDON = mujoco.mjtTrn.mjTRN_JOINT.value, mujoco.mjtTrn.mjTRN_TENDON.value


class Servo(NamedTuple):
    """A servo: its joint's target, a position or a speed, is shift + factor · control."""

    control: int
    factor: float
    shift: float
    limits: tuple[float, float]
    of_speed: bool

    def targets(self, controls: np.ndarray) -> np.ndarray:
        """(T,) target of the joint for (T, nu) controls."""
        return self.shift + self.factor * np.clip(controls[:, self.control], *self.limits)


def servos_of(simulator: Simulator, sensors: Sequence[JointSensor]) -> list[Servo | None]:
    """For each reading the servo that actions command, or None, as for speeds at a position's."""
    by_joint = _by_joint(simulator)
    found = [(s, by_joint.get(s.joints[column])) for s, column in columns_of(sensors)]
    return [
        None
        if servo is None or sensor.is_torque or (sensor.is_velocity and not servo.of_speed)
        else servo
        for sensor, servo in found
    ]


def on_tendons(simulator: Simulator) -> list[str]:
    """Names of servos on tendons that actions command: which joint follows one, nothing says."""
    model = simulator.model
    are_servos = position_servos(model) | velocity_servos(model)
    are_servos &= are_commanded(model, simulator.action_mapping.names)
    found = np.flatnonzero(are_servos & (model.actuator_trntype == _TENDON))
    return [actuator_name(model, i) for i in found.tolist()]


def commanded_spans(simulator: Simulator, actions: Sequence[np.ndarray]) -> dict[str, float]:
    """{joint with a servo of positions: how far apart its targets are}, for (T, A) actions.

    Empty for actions that displace joints from where they are.
    """
    servos = {name: servo for name, servo in _by_joint(simulator).items() if not servo.of_speed}
    if simulator.action_mapping.is_relative or not servos:
        return {}
    batch, together = Batch(simulator.model, _CHUNK), np.concatenate(list(actions))
    chunks = [together[i : i + _CHUNK] for i in range(0, len(together), _CHUNK)]
    controls = np.concatenate([_controls(simulator, batch, chunk) for chunk in chunks])
    return {name: float(np.ptp(servo.targets(controls))) for name, servo in servos.items()}


def _by_joint(simulator: Simulator) -> dict[str, Servo]:
    """The servos that actions command, by the names of their joints; of two the position's."""
    model, by_joint = simulator.model, dict[str, Servo]()
    of_speed = velocity_servos(model)
    are_servos = position_servos(model) | of_speed
    are_servos &= are_commanded(model, simulator.action_mapping.names)
    for i in np.flatnonzero(model.actuator_ctrlnum == 1):
        control, output = int(model.actuator_ctrladr[i]), model.actuator_outadr[i]
        gear = model.actuator_gear[output, 0]
        moves_joint = model.actuator_trntype[i] == _JOINT
        if not (are_servos[i] and moves_joint and gear):
            continue
        name = model.joint(int(model.actuator_trnid[i, 0])).name
        if name in by_joint and of_speed[i]:
            continue
        shift, factor = joint_target(model, int(i))
        limits = control_limits(model, control)
        by_joint[name] = Servo(control, factor, shift, limits, bool(of_speed[i]))
    return by_joint


def commands_of(
    simulator: Simulator, sensors: Sequence[JointSensor], trajectories: Sequence[Trajectory]
) -> list[np.ndarray]:
    """(T, nu) controls of each episode, as the task's actions give them.

    Relative actions displace joints from their measured positions, missing ones interpolated.
    """
    batch, by_episode = Batch(simulator.model, _CHUNK), []
    for trajectory in trajectories:
        controls = []
        positions = {s.name: s for s in sensors if s.is_position}
        read = {name: filled(trajectory.readings[name][None])[0] for name in positions}
        for start in range(0, len(trajectory), _CHUNK):
            actions = trajectory.actions[start : start + _CHUNK]
            for name, sensor in positions.items():
                here = read[name][start : start + len(actions)]
                batch.qpos[: len(here), sensor.places] = here
            controls.append(_controls(simulator, batch, actions))
        by_episode.append(np.concatenate(controls))
    return by_episode


def _controls(simulator: Simulator, batch: Batch, actions: np.ndarray) -> np.ndarray:
    """(T, nu) of at most a chunk of (T, A) actions."""
    num = len(actions)
    padded = np.pad(actions.astype(float), ((0, _CHUNK - num), (0, 0)), mode="edge")
    return simulator.action_mapping.apply(batch, padded)[:num].copy()
