"""The real world that a command names: `pseudo`, a robot, or recordings."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from simtune.cameras.views import View
from simtune.config import ROBOTS, RealConfig, RecordingsConfig, TrainConfig
from simtune.config.robot import Driver
from simtune.devices import choose_device
from simtune.errors import InputError, UnknownName
from simtune.observation import ObservationModel, Sensor
from simtune.parameters import ParameterSpace
from simtune.real import RealWorld
from simtune.real.gap import RealityGap
from simtune.real.recorded import RecordedReal
from simtune.real.robot import A_FEW, RobotReal
from simtune.real.robot_file import read_robot
from simtune.real.truth import Truth
from simtune.recordings import Dataset, open_dataset
from simtune.run.config import FILMED, stored_config
from simtune.tasks import AnyTask, Task

_OTHER_ORDER = 50.0  # factor between the duration of recorded steps and the task's


def choose_real(
    config: RealConfig,
    task: AnyTask,
    image_size: int,
    *,
    real_episodes: int | None = None,
    out: Path | None = None,
) -> tuple[RealWorld, np.ndarray, Truth | None]:
    """The real world, the (N,) parameters at which the search starts, and the truth if known.

    `pseudo`: a simulated world of `real_parameters`, optionally behind a RealityGap; the search
    starts `start_factor` times too high or too low. For a robot or recordings it starts at the
    nominal parameters. A robot films into the run's folder `out` and moves only with `move`;
    without it, if a run has to film and nothing is filmed yet, a dry run ends in an InputError that
    tells what it found.
    The first `real_episodes` recordings (None: a few) are read at once, so that unsound ones are
    reported before anything is written. Raises InputError for what cannot be read.
    """
    config.check_real()
    space = task.parameters
    if config.real == "pseudo":
        truth = Truth(space, read_parameters(config.real_parameters, space))
        gap = RealityGap.of(config, image_size)
        seen = observed(task, config.observed, is_simulated=gap is None)
        views = _views(seen, image_size)
        if gap:
            simulator = gap.simulator(task, views)
        else:
            device = choose_device(config.device)
            simulator = task.simulator(image_size=image_size, views=views, device=device)
        steps = task.episode_steps
        real = truth.make_real(
            simulator, episode_steps=steps, seed=config.seed, gap=gap, observation=seen
        )
        return real, truth.wrong_start(config.seed, config.start_factor), truth
    if config.real in ROBOTS:
        if observed(task, config.observed, is_simulated=False).sensors:
            raise InputError(
                f"--real {config.real} films, and hands out no readings yet: give --observe cameras"
            )
        return _robot(config, task, image_size, out), space.nominal.copy(), None
    seen = observed(task, config.observed, is_simulated=False)
    dataset = open_recordings(config.real, task, config, image_size, seen)
    real = RecordedReal(dataset, seen.framed(dataset.aspects))
    if real_episodes != 0:
        real.collect(real_episodes)
    return real, space.nominal.copy(), None


def _views(seen: ObservationModel, image_size: int) -> list[View]:
    """What a pseudo-real world's cameras show, with the picture files that are behind it."""
    both = zip(seen.cameras, seen.views(), strict=True)
    plates = [c.footage.picture((image_size, view.width(image_size))) for c, view in both]
    return seen.views(plates)


def _robot(config: RealConfig, task: AnyTask, image_size: int, out: Path | None) -> RobotReal:
    """A robot that may move, need not, or has filmed already; else a dry run, then InputError."""
    assert config.robot is not None, "checked"
    if out is None:
        raise ValueError("a robot needs a folder `out` to film into")
    driver: Driver = "xarm" if config.real == "xarm" else "lerobot"
    robot = read_robot(config.robot, driver)
    stored_config(out)  # refuses a folder that cannot be a run's, before anything moves
    real = RobotReal(
        robot, task, image_size=image_size, seed=config.seed, folder=out / FILMED, move=config.move
    )
    if config.has_search and not config.move:
        _check_filmed(config, real)
    return real


def _check_filmed(config: RealConfig, real: RobotReal) -> None:
    """Raises InputError at once, where nothing may move, if a run has to film: now or later."""
    num_filmed = real.num_filmed
    if not num_filmed:
        raise InputError(f"dry run: {real.dry_run()}; give --move to let it move")
    if not isinstance(config, TrainConfig):
        return
    first, tries = config.real_episodes or A_FEW, config.tried_episodes != 0
    if num_filmed < first + tries:
        then = ", and then some of its policy (none with --tried-episodes 0)" if tries else ""
        raise InputError(
            f"the robot has to move for this: this training needs {first} episodes{then}, and "
            f"{num_filmed} are filmed: give --move"
        )


def observed(task: AnyTask, names: Sequence[str] | None, *, is_simulated: bool) -> ObservationModel:
    """What is observed of a task's real world; `names` are those of `--observe`, None: default.

    Raises InputError if there is no such sensor, or nothing is left.
    """
    sensors: Sequence[Sensor] = task.sensors if isinstance(task, Task) else ()
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
    dataset = open_dataset(
        path,
        cameras=[replace(footage, key=config.camera or footage.key) for footage in films],
        image_size=image_size,
        num_actions=len(task.load_actions().names),
        actions=config.action_names or (task.action_columns if isinstance(task, Task) else None),
        control_hz=config.control_hz,
        readings={sensor.name: sensor.columns for sensor in observation.sensors},
    )
    _check_pace(dataset, task)
    return dataset


def _check_pace(dataset: Dataset, task: AnyTask) -> None:
    """Raises InputError for steps of another order than the task's, which take hours to play."""
    if max(ratio := dataset.step_s / task.step_s, 1 / ratio) > _OTHER_ORDER:
        raise InputError(
            f"{dataset.where}: its rows come {1 / dataset.step_s:.3g} times a second, and "
            f"{task.name} takes {1 / task.step_s:.3g} steps; are its times in seconds? If so, say "
            "control_timestep_s in the tuning file accordingly, or --control-hz"
        )


def read_parameters(path: Path | None, space: ParameterSpace) -> np.ndarray:
    """(N,) parameters from a JSON object of names and values; missing ones are nominal.

    Also accepts a run's result.json, or parameters.json of an export.
    """
    if path is None:
        return space.nominal.copy()
    try:
        values: Any = json.loads(Path(path).read_text())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path} is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise InputError(f"{path} must hold one JSON object of names and values")
    found = values.get("parameters")
    if isinstance(found, dict):
        means = (e.get("mean") if isinstance(e, dict) else e for e in found.values())
        values = dict(zip(found, means, strict=True))
    return space.from_dict(values)
