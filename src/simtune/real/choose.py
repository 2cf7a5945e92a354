"""The real world that a command names: `pseudo`, or recordings."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from simtune.config import RecordingsConfig
from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.real import RealWorld
from simtune.real.gap import RealityGap
from simtune.real.recorded import RecordedReal
from simtune.real.truth import Truth
from simtune.recordings import Dataset, open_dataset
from simtune.simulation import Simulator
from simtune.tasks import Task

_AS_RECORDED = RecordingsConfig()


def choose_real(
    name: str,
    task: Task,
    real_parameters: Path | None = None,
    *,
    recordings: RecordingsConfig = _AS_RECORDED,
    image_size: int,
    seed: int,
    real_episodes: int | None = None,
    real_gap: bool = False,
    start_factor: float = 2.0,
) -> tuple[RealWorld, np.ndarray, Truth | None]:
    """A real world, where the search for its parameters starts (N,), and the truth, where known.

    `pseudo`: a simulated world of `real_parameters`, searched from ×2/×½ of them
    (or `start_factor`); `real_gap` puts
    a RealityGap before it. Anything else is where `recordings` lie, searched from the nominal
    parameters; the first `real_episodes` of them (None: a few) are read at once, so that what is
    unsound is said before anything is written.
    Raises InputError for what cannot be read.
    """
    space = task.parameters
    if name == "pseudo":
        truth = Truth(space, read_parameters(real_parameters, space))
        gap = RealityGap.draw(image_size, seed) if real_gap else None
        simulator = gap.simulator(task) if gap else task.simulator(image_size=image_size)
        real = truth.make_real(simulator, episode_steps=task.episode_steps, seed=seed, gap=gap)
        return real, truth.wrong_start(seed, start_factor), truth
    if real_parameters is not None:
        raise InputError("--real-parameters goes with --real pseudo only")
    if name == "xarm":
        raise InputError("--real xarm is not there yet; record episodes and give their folder")
    dataset = open_recordings(name, task, recordings, image_size)
    real = RecordedReal(dataset)
    if real_episodes != 0:
        real.collect(real_episodes)
    return real, space.nominal.copy(), None


def open_recordings(
    path: str | Path, task: Task, config: RecordingsConfig, image_size: int
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


def simulator_for(real: RealWorld, task: Task, image_size: int) -> Simulator:
    """Worlds of `task` to compare with a real one: actions last as long, pictures are alike."""
    # A real camera averages over its pixels; the simulator's own does not.
    supersampling = 1 if real.looks_like_simulator else 2
    return task.simulator(image_size=image_size, step_s=real.step_s, supersampling=supersampling)


def read_parameters(path: Path | None, space: ParameterSpace) -> np.ndarray:
    """(N,) parameters from a JSON object of names and values; what is missing is nominal."""
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
    return space.from_dict(values)
