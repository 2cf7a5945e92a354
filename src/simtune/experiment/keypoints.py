"""Which keypoints a run follows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from simtune.fit import left_open, set_up_loop
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.simulation import AnySimulator, Points
from simtune.tasks import AnyTask
from simtune.vision.keypoints import Keypoints, every_keypoint, find_keypoints


def keypoints_of_run(
    simulator: AnySimulator,
    task: AnyTask,
    seed: int,
    state: Mapping[str, Any] | None,
    seen: ObservationModel | None,
) -> Keypoints | Points:
    """Those of a checkpoint's state, if there is one, since its networks were trained on them.

    Another machine may find others. Without a camera there are none. If `seen`, what is observed,
    has joint readings, those of what they leave open; policies need all.
    """
    points, nominal = every_keypoint(simulator), task.parameters.nominal
    if state is not None:
        return points.with_state(state["keypoints"])
    if isinstance(points, Keypoints) and seen and seen.sensors:
        loop = set_up_loop(simulator, seen, nominal)
        points = points.select(np.flatnonzero(left_open(loop, points, nominal)).tolist())
    return find_keypoints(simulator, Distribution.first(task.parameters, nominal), seed, points)
