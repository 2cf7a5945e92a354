"""What is observed of a task's real world, and recordings of it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from simtune.config import RecordingsConfig
from simtune.errors import InputError, UnknownName
from simtune.observation import JointSensor, ObservationModel
from simtune.real.turnings import turnings_of
from simtune.recordings import Dataset, open_dataset
from simtune.tasks import AnyTask, Task

_MAX_DURATION_RATIO = 50.0  # between recorded steps and the task's


def observed(task: AnyTask, names: Sequence[str] | None, *, is_simulated: bool) -> ObservationModel:
    """What is observed of a task's real world; `names` are those of `--observe`, None: default.

    Raises InputError if there is no such sensor, or nothing is left.
    """
    sensors: Sequence[JointSensor] = task.sensors if isinstance(task, Task) else ()
    kinds = ["cameras"] * bool(task.cameras) + ["joints"] * bool(sensors)
    there = [*kinds, *(footage.name for footage in task.cameras), *(s.name for s in sensors)]
    for name in names or ():
        if name not in there:
            raise UnknownName("sensor", name, f"{task.name}, as --observe has it", there)
    of = ObservationModel.of_simulator if is_simulated else ObservationModel.of_reality
    usual = task.looks_at if isinstance(task, Task) else None
    return of(tuple(sensors), task.cameras).only((usual or there) if names is None else names)


def open_recordings(
    path: str | Path,
    task: AnyTask,
    config: RecordingsConfig,
    image_size: int | None,
    observation: ObservationModel,
) -> Dataset:
    """Recordings with the observed sensors and the task's actions. Raises InputError if not so."""
    films = [camera.footage for camera in observation.cameras]
    if config.camera and len(films) > 1:
        raise InputError("--camera names one of the recordings' cameras; here [[cameras]] does")
    turnings = []
    if isinstance(task, Task):
        turnings = turnings_of(task.nominal_model, task.load_actions(), observation.sensors)
    dataset = open_dataset(
        path,
        cameras=[replace(footage, key=config.camera or footage.key) for footage in films],
        image_size=image_size,
        num_actions=len(task.load_actions().names),
        actions=config.action_names or (task.action_columns if isinstance(task, Task) else None),
        control_hz=config.control_hz,
        leave_out=config.left_out,
        readings={sensor.name: sensor.columns for sensor in observation.sensors},
        turnings=turnings,
    )
    _check_pace(dataset, task)
    return dataset


def _check_pace(dataset: Dataset, task: AnyTask) -> None:
    """Raises InputError for steps of another order than the task's, which take hours to play."""
    if max(ratio := dataset.step_s / task.step_s, 1 / ratio) > _MAX_DURATION_RATIO:
        raise InputError(
            f"{dataset.where}: its rows come {1 / dataset.step_s:.3g} times a second, and "
            f"{task.name} takes {1 / task.step_s:.3g} steps; are its times in seconds? If so, say "
            "control_timestep_s in the tuning file accordingly, or --control-hz"
        )
