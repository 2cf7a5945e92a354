"""`simtune check --camera-pose`, top to bottom."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from simtune.budget import Budget
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.scene import measured_states, with_any_camera
from simtune.camera_pose.search import CameraSearch, Film
from simtune.camera_pose.written import describe, tuning_table
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.pictures import resize
from simtune.progress import ReportProgress, silent
from simtune.real.choose import observed, open_recordings
from simtune.real.recorded import RecordedReal
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory

_MOST_FRAMES = 240  # that are looked at
_FEWEST_FRAMES = 8
_HEIGHT_PX = 128  # of pictures: nothing has to be learnt, so that they may be large


def find_camera_pose(config: CheckConfig, say: ReportProgress = silent) -> dict[str, Any]:
    """A camera's position, orientation and field of view, with 90 % intervals; JSON.

    Raises InputError for what cannot be used.
    """
    config.check()
    budget = Budget(60 * config.budget_minutes, say)
    declared = load_task(config.task)
    seen = observed(declared, config.observed, is_simulated=False)
    if len(seen.cameras) != 1:
        raise InputError(
            f"--camera-pose finds one camera at a time, here are {len(seen.cameras)}; name one "
            "and the joints, as --observe NAME,joints"
        )
    task = with_any_camera(declared, seen.cameras[0].footage, config)
    image_size = config.image_size or _HEIGHT_PX
    budget.report("reading the recordings")
    dataset = open_recordings(config.real or "", task, config, image_size, seen)
    real = RecordedReal(dataset, seen.framed(dataset.aspects))
    trajectories = real.collect(config.episodes)
    simulators = [
        _simulator(task, real.observation, trajectories, height, k)
        for height, k in ((image_size // 2, 1), (image_size, real.observation.supersampling))
    ]
    frames, states = _known(simulators[1], real.observation, trajectories)
    coarse, fine = (
        Film(Robot(simulator, real.observation, config.seed), _shrunk(frames, simulator.shape))
        for simulator in simulators
    )
    camera, errors = CameraSearch(coarse, fine, states, config.seed).run(budget)
    result = describe(task, camera, errors, len(frames))
    if config.camera_pose:
        config.camera_pose.write_text(tuning_table(result))
    return result


def _simulator(
    task: Task,
    seen: ObservationModel,
    trajectories: Sequence[Trajectory],
    image_size: int,
    supersampling: int,
) -> Simulator:
    """One whose pictures are as the recordings', of another size."""
    frames = [trajectory.frames for trajectory in trajectories]
    (view,) = seen.views([seen.cameras[0].footage.plate(frames, frames[0].shape[1:3])])
    if view.plate is not None:
        view = replace(view, plate=resize(view.plate, (image_size, view.width(image_size))))
    return task.simulator(image_size=image_size, views=[view], supersampling=supersampling)


def _shrunk(frames: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    return np.stack([resize(frame, shape) for frame in frames])


def _known(
    simulator: Simulator, seen: ObservationModel, trajectories: list[Trajectory]
) -> tuple[np.ndarray, np.ndarray]:
    """(F, H, W, 3) frames, evenly spread, and the (F, S) states that joints tell of them."""
    rng, nominal = np.random.default_rng(0), simulator.space.nominal[None]
    rest = simulator.roll_out(nominal, np.zeros((1, 0, simulator.num_actions)), rng).states[0, 0]
    states = measured_states(simulator.model, seen, trajectories, rest)
    (known,) = np.nonzero(np.isfinite(states).all(1))
    if len(known) < _FEWEST_FRAMES:
        raise InputError(
            f"joints are known in {len(known)} frames; expected at least {_FEWEST_FRAMES}: are "
            "[[sensors]] those of the recordings?"
        )
    known = known[np.linspace(0, len(known) - 1, min(len(known), _MOST_FRAMES)).astype(int)]
    return np.concatenate([t.frames for t in trajectories])[known], states[known]
