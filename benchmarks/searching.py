"""Searches without a run: what they are made of."""

import numpy as np

from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.tasks import Task
from simtune.tuning import SearchContext
from simtune.vision.keypoints import find_keypoints


def context_of(
    task: Task,
    simulator: Simulator,
    start: np.ndarray,
    seed: int,
    observation: ObservationModel | None = None,
) -> SearchContext:
    """As `simtune tune` makes it; `observation` is by default that of a simulated world."""
    first = Distribution.first(task.parameters, start)
    return SearchContext(
        simulator=simulator,
        camera=task.camera,
        keypoints=find_keypoints(simulator, task.camera, first, seed),
        start=start,
        observation=observation or ObservationModel.of_simulator(),
        seed=seed,
    )
