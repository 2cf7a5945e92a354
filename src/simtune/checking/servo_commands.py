"""Servo commands of actions: controls, as angles and lengths of joints."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.observation import JointSensor
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory

_CHUNK = 256  # worlds whose controls are computed at once
_JOINT = mujoco.mjtTrn.mjTRN_JOINT.value
_AFFINE = mujoco.mjtBias.mjBIAS_AFFINE.value
_INTEGRATOR = mujoco.mjtDyn.mjDYN_INTEGRATOR.value


class ServoOf(NamedTuple):
    """A position servo: its joint's target is shift + factor · control."""

    control: int
    factor: float
    shift: float
    limits: tuple[float, float]

    def targets(self, controls: np.ndarray) -> np.ndarray:
        """(T,) target of the joint for (T, nu) controls."""
        return self.shift + self.factor * np.clip(controls[:, self.control], *self.limits)


def servos_of(simulator: Simulator, sensors: Sequence[JointSensor]) -> list[ServoOf | None]:
    """For each reading the servo that actions command, or None."""
    model, commanded = simulator.model, simulator.action_mapping.names
    by_joint: dict[str, ServoOf] = {}
    for i in range(model.nu):
        pull, gear = -model.actuator_biasprm[i, 1], model.actuator_gear[i, 0]
        is_commanded = (model.actuator(i).name or f"actuator {i}") in commanded
        if not is_commanded or not _is_of_positions(model, i) or not gear:
            continue
        per_length = 1 / (pull * gear)
        limited = bool(model.actuator_ctrllimited[i])
        low, high = model.actuator_ctrlrange[i] if limited else (-np.inf, np.inf)
        by_joint[model.joint(int(model.actuator_trnid[i, 0])).name] = ServoOf(
            int(model.actuator_ctrladr[i]),
            float(model.actuator_gainprm[i, 0] * per_length),
            float(model.actuator_biasprm[i, 0] * per_length),
            (float(low), float(high)),
        )
    return [
        None if sensor.is_velocity else by_joint.get(joint)
        for sensor in sensors
        for joint in sensor.joints
    ]


def _is_of_positions(model: mujoco.MjModel, i: int) -> bool:
    """Whether an actuator drives its joint to the control; not one that integrates it."""
    is_affine = model.actuator_biastype[i] == _AFFINE and model.actuator_biasprm[i, 1] < 0
    moves_joint = model.actuator_trntype[i] == _JOINT
    return bool(is_affine and moves_joint and model.actuator_dyntype[i] != _INTEGRATOR)


def commands_of(
    simulator: Simulator, sensors: Sequence[JointSensor], trajectories: Sequence[Trajectory]
) -> list[np.ndarray]:
    """(T, nu) controls of each episode, as the task's actions give them.

    Relative actions displace joints from their measured positions.
    """
    batch, by_episode = Batch(simulator.model, _CHUNK), []
    for trajectory in trajectories:
        controls = []
        for start in range(0, len(trajectory), _CHUNK):
            actions = trajectory.actions[start : start + _CHUNK].astype(float)
            for sensor in sensors:
                if not sensor.is_velocity:
                    read = trajectory.readings[sensor.name][start : start + len(actions)]
                    batch.qpos[: len(read), sensor.places] = np.nan_to_num(read)
            padded = np.pad(actions, ((0, _CHUNK - len(actions)), (0, 0)), mode="edge")
            applied = simulator.action_mapping.apply(batch, padded)
            controls.append(applied[: len(actions)])
        by_episode.append(np.concatenate(controls))
    return by_episode
