"""The real world that a command names: `pseudo`, a robot, or a folder of recordings."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from simtune.config.robot import Driver
from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.real import RealWorld
from simtune.real.gap import RealityGap
from simtune.real.recorded import RecordedReal
from simtune.real.robot import RobotReal
from simtune.real.robot_file import read_robot
from simtune.real.truth import Truth
from simtune.run.config import FILMED, stored_config
from simtune.simulation import AnySimulator
from simtune.tasks import AnyTask, Task


def choose_real(
    name: str,
    task: AnyTask,
    real_parameters: Path | None = None,
    *,
    camera: str | None = None,
    image_size: int,
    seed: int,
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
    the folder of a LeRobotDataset v3. They are searched from the nominal parameters.
    Raises InputError for what cannot be read.
    """
    space = task.parameters
    driver: Driver | None = name if name == "xarm" or name == "lerobot" else None
    if camera is not None and (driver or name == "pseudo"):
        raise InputError("--camera goes with recordings only")
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
        stored_config(out)  # refuses what cannot be a run's folder, before anything moves
        settings = {"image_size": image_size, "seed": seed, "folder": out / FILMED}
        robot_real = RobotReal(read_robot(robot, driver), task, move=move, **settings)
        if not move and not robot_real.num_filmed:
            raise InputError(f"dry run: {robot_real.dry_run()}; give --move to let it move")
        return robot_real, space.nominal.copy(), None
    num_actions = len(task.load_actions().names)
    real = RecordedReal(name, camera=camera, image_size=image_size, num_actions=num_actions)
    return real, space.nominal.copy(), None


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
