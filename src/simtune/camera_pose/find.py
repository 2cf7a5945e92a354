"""`simtune check --camera-pose`, top to bottom."""

from dataclasses import replace
from typing import Any

import numpy as np

from simtune.budget import Budget
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.lens_check import lens_warnings
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.scene import measured_states, unlocated_geoms, with_any_camera
from simtune.camera_pose.search import CameraSearch
from simtune.camera_pose.written import describe, tuning_table
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.progress import ReportProgress, silent
from simtune.real.observed import observed, open_recordings
from simtune.real.recorded import RecordedReal
from simtune.run.files import write_atomically
from simtune.simulation import Simulator
from simtune.simulation.rendering.plate import camera_moves
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory

_MOST_FRAMES = 240  # that are used
_FEWEST_FRAMES = 8
_HEIGHT_PX = 240  # of pictures; large, since no network has to learn from them


def find_camera_pose(config: CheckConfig, report: ReportProgress = silent) -> dict[str, Any]:
    """A camera's position, orientation and field of view, with 90 % intervals; JSON.

    They are written to a file, if one is asked for and the camera `is_found`. Raises InputError
    for invalid input.
    """
    config.check()
    budget = Budget(60 * config.budget_minutes, report)
    declared = load_task(config.task)
    observation = observed(declared, config.observed, is_simulated=False)
    if len(observation.cameras) != 1:
        raise InputError(
            f"--camera-pose finds one camera at a time, here are {len(observation.cameras)}; name "
            "one and the joints, as --observe NAME,joints"
        )
    looked_at = replace(declared, sensors=observation.sensors)
    task = with_any_camera(looked_at, observation.cameras[0].footage, config)
    budget.report("reading the recordings")
    dataset = open_recordings(
        config.real or "", task, config, config.image_size or _HEIGHT_PX, observation
    )
    real = RecordedReal(dataset, observation.framed(dataset.aspects))
    trajectories = real.collect(config.episodes)
    result = find_pose(task, real.observation, trajectories, budget, config.seed)
    if config.camera_pose and result["is_found"]:
        write_atomically(config.camera_pose, tuning_table(result))
    return result


def find_pose(
    task: Task,
    observation: ObservationModel,
    trajectories: list[Trajectory],
    budget: Budget,
    seed: int = 0,
) -> dict[str, Any]:
    """The same for a task `with_any_camera`, from trajectories with frames of the height to be
    compared.
    """
    simulator = task.simulator(image_size=1, views=())
    camera = observation.cameras[0].footage.camera
    frames, states = _known(simulator, observation, trajectories)
    size = (frames.shape[1], frames.shape[2])
    geometry = CameraGeometry.of(simulator.model, camera, task.parameters, size)
    hidden = unlocated_geoms(simulator.model, camera, observation)
    robot = Robot(simulator.model, camera, states, geometry, hidden)
    plate = None if camera_moves(simulator.model, camera) else np.median(frames, 0)
    lens = task.cameras[0].lens
    found = CameraSearch(frames, plate, robot, geometry, seed, lens).run(budget)
    result = describe(task, found, len(frames))
    return result | {"warnings": [*result["warnings"], *lens_warnings(found, lens)]}


def _known(
    simulator: Simulator, observation: ObservationModel, trajectories: list[Trajectory]
) -> tuple[np.ndarray, np.ndarray]:
    """(F, H, W, 3) frames, evenly spread, and their (F, S) states from joint readings."""
    rest = simulator.begin(simulator.space.nominal[None], np.random.default_rng(0)).states[0, 0]
    states = measured_states(simulator.model, observation, trajectories, rest)
    (known,) = np.nonzero(np.isfinite(states).all(1))
    if len(known) < _FEWEST_FRAMES:
        raise InputError(
            f"joints are known in {len(known)} frames; expected at least {_FEWEST_FRAMES}: are "
            "[[sensors]] those of the recordings?"
        )
    known = known[np.linspace(0, len(known) - 1, min(len(known), _MOST_FRAMES)).astype(int)]
    return np.concatenate([t.frames for t in trajectories])[known], states[known]
