"""The real world that a command names: `pseudo`, a robot, or recordings."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from simtune.config import RecordingsConfig
from simtune.config.robot import Driver, RobotConfig
from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.real import RealWorld
from simtune.real.gap import RealityGap
from simtune.real.recorded import RecordedReal
from simtune.real.robot import RobotReal
from simtune.real.robot_file import read_robot
from simtune.real.truth import Truth
from simtune.recordings import Dataset, open_dataset
from simtune.run.config import FILMED, stored_config
from simtune.simulation import AnySimulator
from simtune.tasks import AnyTask, Task

_AS_RECORDED = RecordingsConfig()


def choose_real(
    name: str,
    task: AnyTask,
    real_parameters: Path | None = None,
    *,
    recordings: RecordingsConfig = _AS_RECORDED,
    image_size: int,
    seed: int,
    real_episodes: int | None = None,
    real_gap: bool = False,
    robot: Path | None = None,
    move: bool = False,
    out: Path | None = None,
    start_factor: float = 2.0,
) -> tuple[RealWorld, np.ndarray, Truth | None]:
    """A real world, where the search for its parameters starts (N,), and the truth, where known.

    `pseudo`: a simulated world of `real_parameters`, searched from ×2/×½ of them
    (or `start_factor`); `real_gap` puts a RealityGap before it. `xarm`, `lerobot`: the robot of a
    file, which films into the run's folder `out` and moves only with `move`; without it, and with
    nothing filmed yet, a dry run ends in an InputError that says what it found. Anything else is
    where `recordings` lie; the first `real_episodes` of them (None: a few) are read at once, so
    that what is unsound is said before anything is written. Both are searched from the nominal
    parameters.
    Raises InputError for what cannot be read.
    """
    space = task.parameters
    driver: Driver | None = name if name == "xarm" or name == "lerobot" else None
    if not driver and (robot is not None or move):
        raise InputError("--robot and --move go with --real xarm or lerobot only")
    if name == "pseudo":
        truth = Truth(space, read_parameters(real_parameters, space))
        gap = RealityGap.draw(image_size, seed) if real_gap else None
        if gap and isinstance(task, Task):
            simulator = gap.simulator(task)
        elif gap:
            raise InputError("--real-gap needs a MuJoCo model, to draw it another way")
        else:
            simulator = task.simulator(image_size=image_size)
        real = truth.make_real(simulator, episode_steps=task.episode_steps, seed=seed, gap=gap)
        return real, truth.wrong_start(seed, start_factor), truth
    if real_parameters is not None:
        raise InputError("--real-parameters goes with --real pseudo only")
    if driver:
        if robot is None or out is None:
            raise InputError(f"--real {name} needs --robot FILE.toml (see docs/robot.md)")
        real = _robot(read_robot(robot, driver), task, image_size, seed, move, out)
        return real, space.nominal.copy(), None
    real = RecordedReal(open_recordings(name, task, recordings, image_size))
    if real_episodes != 0:
        real.collect(real_episodes)
    return real, space.nominal.copy(), None


def _robot(
    config: RobotConfig, task: AnyTask, image_size: int, seed: int, move: bool, out: Path
) -> RobotReal:
    """One that may move, or has filmed something already. Raises InputError after a dry run."""
    stored_config(out)  # refuses what cannot be a run's folder, before anything moves
    folder = out / FILMED
    real = RobotReal(config, task, image_size=image_size, seed=seed, folder=folder, move=move)
    if not move and not real.num_filmed:
        raise InputError(f"dry run: {real.dry_run()}; give --move to let it move")
    return real


def open_recordings(
    path: str | Path, task: AnyTask, config: RecordingsConfig, image_size: int
) -> Dataset:
    """Recordings whose actions fit a task. Raises InputError for others."""
    return open_dataset(
        path,
        camera=config.camera,
        image_size=image_size,
        num_actions=len(task.load_actions().names),
        actions=config.action_names,
        control_hz=config.control_hz,
    )


def simulator_for(real: RealWorld, task: AnyTask, image_size: int) -> AnySimulator:
    """Worlds of `task` to compare with a real one: actions last as long, pictures are alike."""
    # A real camera averages over its pixels; the simulator's own does not.
    supersampling = 1 if real.looks_like_simulator else 2
    return task.simulator(image_size=image_size, step_s=real.step_s, supersampling=supersampling)


def read_parameters(path: Path | None, space: ParameterSpace) -> np.ndarray:
    """(N,) parameters from a JSON object of names and values; what is missing is nominal.

    What a run found will do as well: its result.json, or parameters.json of an export.
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
    if isinstance(found, dict) and all("mean" in entry for entry in found.values()):
        values = {name: entry["mean"] for name, entry in found.items()}
    return space.from_dict(values)
