"""The real world that a command names: `pseudo`, a robot, or recordings."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from simtune.cameras.views import View
from simtune.config import ROBOTS, RealConfig
from simtune.devices import choose_device
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.parameters.values_file import read_parameters
from simtune.real import RealWorld
from simtune.real.gap import RealityGap
from simtune.real.observed import observed, open_recordings
from simtune.real.recorded import RecordedReal
from simtune.real.robot import RobotReal
from simtune.real.truth import Truth
from simtune.robot.robot_file import Driver, read_robot
from simtune.run.config import FILMED, stored_config
from simtune.tasks import AnyTask


class ChosenReal(NamedTuple):
    """A real world, and what is known of its parameters."""

    real: RealWorld
    start: np.ndarray  # (N,) parameters at which the search starts
    truth: Truth | None  # of a pseudo-real world


def choose_real(
    config: RealConfig,
    task: AnyTask,
    image_size: int,
    *,
    real_episodes: int | None = None,
    out: Path | None = None,
) -> ChosenReal:
    """The real world that `config` names, and where its search starts.

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
        return _pseudo(config, task, image_size)
    seen = observed(task, config.observed, is_simulated=False)
    if config.real in ROBOTS:
        if seen.sensors:
            raise InputError(
                f"--real {config.real} films, and hands out no readings yet: give --observe cameras"
            )
        return ChosenReal(_robot(config, task, image_size, out), space.nominal.copy(), None)
    dataset = open_recordings(config.real, task, config, image_size, seen)
    real = RecordedReal(dataset, seen.framed(dataset.aspects))
    if real_episodes != 0:
        real.collect(real_episodes)
    return ChosenReal(real, space.nominal.copy(), None)


def _pseudo(config: RealConfig, task: AnyTask, image_size: int) -> ChosenReal:
    """A simulated world, behind a reality gap if that is asked for."""
    truth = Truth(task.parameters, read_parameters(config.real_parameters, task.parameters))
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
    return ChosenReal(real, truth.wrong_start(config.seed, config.start_factor), truth)


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
    if config.has_search and not config.move and not real.num_filmed:
        raise InputError(f"dry run: {real.dry_run()}; give --move to let it move")
    return real
