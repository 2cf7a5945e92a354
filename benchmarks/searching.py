"""Searches without a run: what they are made of."""

import time

import numpy as np

from simtune.budget import Budget
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.tasks import Task
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import Estimate
from simtune.tuning.search import Search, SearchContext
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
        keypoints=find_keypoints(simulator, first, seed),
        start=start,
        observation=observation or ObservationModel.of_simulator(),
        seed=seed,
    )


def run_rounds(search: Search, real: list[Trajectory], budget: Budget) -> Estimate:
    """The last round's estimate, where as many are run as `simtune tune` runs."""
    while True:
        began_s = time.monotonic()
        estimate, _, _ = search.run_round(real, budget)
        if search.stop_reason or budget.seconds_left < time.monotonic() - began_s:
            return estimate
