"""What `check` asks of joint readings: how servos follow, and what parameters change in them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.check.servo_doubts import doubts
from simtune.check.servos import Servo, fit_servo
from simtune.fit import Readings
from simtune.fit.reading_sensitivity import ReadingChanges, ReplayedReadings
from simtune.fit.sensitivity import one_by_one, where_analyzed
from simtune.observation import JointSensor, ObservationModel
from simtune.recordings import Dataset
from simtune.run.files import plain
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory

_CORRELATED_S = 0.5  # for which what is left of a reading goes on: a model's fault, no noise
_LEFT = 0.03  # of how far a reading moves, that a fit may leave where no servo says how much
_FEWEST_STEPS = 8
_CHUNK = 256  # worlds of which controls are asked at once
_JOINT = mujoco.mjtTrn.mjTRN_JOINT.value
_ASSUMED_OF_RECORDINGS = (
    f"as if what a lag and an offset leave of each reading, for {_CORRELATED_S:g} s at a "
    "time, were left by the best fit, too"
)
_ASSUMED = "as if readings had no errors but their sensors' noise"


class ReadEpisodes(NamedTuple):
    """Recorded readings, and how their joints followed."""

    trajectories: list[Trajectory]  # without pictures
    servos: dict[str, Servo]  # by reading
    facts: dict[str, Any]  # JSON
    warnings: list[str]


class _ServoOf(NamedTuple):
    """A servo of positions: its joint's target is shift + factor · control."""

    name: str
    control: int
    factor: float
    shift: float
    limits: tuple[float, float]


def read_episodes(
    dataset: Dataset, num: int, simulator: Simulator, observation: ObservationModel
) -> ReadEpisodes:
    """The first `num` episodes. Raises InputError where one is unsound."""
    trajectories = [_trajectory(dataset, episode, observation) for episode in range(num)]
    servos, found = {}, []
    sensors = [s for s in observation.sensors if isinstance(s, JointSensor)]
    labels = observation.reading_labels
    units = [sensor.unit for sensor in sensors for _ in sensor.labels]
    followed = _servos_of(simulator, sensors)
    commands = _commands(simulator, sensors, trajectories) if any(followed) else []
    read = Readings.of(trajectories, sensors).values
    for column, its in enumerate(followed):
        if its is None or len(trajectories[0]) < _FEWEST_STEPS:
            continue
        asked = [its.shift + its.factor * np.clip(c[:, its.control], *its.limits) for c in commands]
        measured = [read[e, : len(c) + 1, column] for e, c in enumerate(commands)]
        servo = fit_servo(asked, measured, simulator.step_s)
        servos[labels[column]] = servo
        found += doubts(labels[column], units[column], asked, measured, servo, simulator.step_s)
    facts = {
        label: plain({"unit": units[labels.index(label)], **asdict(servo)})
        for label, servo in servos.items()
    }
    return ReadEpisodes(trajectories, servos, facts, found)


def reading_changes(
    simulator: Simulator,
    observation: ObservationModel,
    actions: np.ndarray,
    recorded: ReadEpisodes | None,
    seed: int,
) -> tuple[ReadingChanges, str]:
    """Of every parameter, in episodes of (E, T, A) actions; and what is assumed of errors."""
    sensors = tuple(s for s in observation.sensors if isinstance(s, JointSensor))
    nominal = where_analyzed(simulator.space)
    readings = Readings.of(recorded.trajectories, sensors) if recorded else None
    replayed = ReplayedReadings(simulator, observation, nominal, actions, readings, seed)
    noise = np.concatenate([np.full(s.size, s.noise_or_usual) for s in sensors])
    if recorded and readings:
        left = _left(readings.values, recorded.servos, observation.reading_labels)
        noise = np.maximum(noise, left) * np.sqrt(max(1.0, _CORRELATED_S / simulator.step_s))
    changes = replayed.changes(one_by_one(simulator.space, nominal), noise)
    return changes, _ASSUMED_OF_RECORDINGS if recorded else _ASSUMED


def _left(values: np.ndarray, servos: Mapping[str, Servo], labels: Sequence[str]) -> np.ndarray:
    """(D,) root mean square of what the best fit may leave of (E, T + 1, D) readings."""
    flat = values.reshape(-1, values.shape[-1])
    usual = _LEFT * np.ptp(np.nanpercentile(flat, (1, 99), axis=0), axis=0)
    known = np.array([servos[n].filtered_rms if n in servos else np.nan for n in labels])
    return np.where(np.isfinite(known), known, usual)


def _trajectory(dataset: Dataset, episode: int, observation: ObservationModel) -> Trajectory:
    """Its readings in their sensors' units, without pictures."""
    actions, recorded = dataset.measured(episode)
    readings = {
        sensor.name: sensor.from_recorded(recorded[sensor.name], dataset.step_s)
        for sensor in observation.sensors
    }
    frames = np.empty((len(actions) + 1, 0, 0, 3), np.uint8)
    return Trajectory(frames, actions, dataset.step_s, readings)


def _servos_of(simulator: Simulator, sensors: Sequence[JointSensor]) -> list[_ServoOf | None]:
    """Of each reading the servo that actions command; None where there is none."""
    model, commanded = simulator.model, simulator.action_mapping.names
    by_joint: dict[str, _ServoOf] = {}
    for i in range(model.nu):
        name, pull = model.actuator(i).name or f"actuator {i}", -model.actuator_biasprm[i, 1]
        if name not in commanded or pull <= 0 or model.actuator_trntype[i] != _JOINT:
            continue
        per_length = 1 / (pull * model.actuator_gear[i, 0])
        limited = bool(model.actuator_ctrllimited[i])
        low, high = model.actuator_ctrlrange[i] if limited else (-np.inf, np.inf)
        by_joint[model.joint(int(model.actuator_trnid[i, 0])).name] = _ServoOf(
            name,
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


def _commands(
    simulator: Simulator, sensors: Sequence[JointSensor], trajectories: Sequence[Trajectory]
) -> list[np.ndarray]:
    """(T, nu) controls of each episode, as the task's actions give them.

    Relative ones displace joints from where they were measured.
    """
    batch, every = Batch(simulator.model, _CHUNK), []
    for trajectory in trajectories:
        controls = []
        for start in range(0, len(trajectory), _CHUNK):
            actions = trajectory.actions[start : start + _CHUNK].astype(float)
            for sensor in sensors:
                if not sensor.is_velocity:
                    its = trajectory.readings[sensor.name][start : start + len(actions)]
                    batch.qpos[: len(its), sensor.places] = np.nan_to_num(its)
            padded = np.pad(actions, ((0, _CHUNK - len(actions)), (0, 0)), mode="edge")
            applied = simulator.action_mapping.apply(batch, padded)
            controls.append(applied[: len(actions)])
        every.append(np.concatenate(controls))
    return every
