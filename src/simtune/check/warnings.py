"""What may be wrong with recordings, before anything is learnt from them."""

import numpy as np

from simtune.search_param_model.judge import SHORTEST_STEPS
from simtune.tasks import Task
from simtune.trajectory import Trajectory


def warnings(task: Task, trajectories: list[Trajectory]) -> list[str]:
    """Of recordings that a task's worlds are to replay, a sentence each."""
    found = []
    step_s = trajectories[0].step_s
    if abs(step_s / task.step_s - 1) > 0.01:
        found.append(
            f"{1 / step_s:.4g} actions/s were recorded, the task usually takes "
            f"{1 / task.step_s:.4g}; the simulator follows the recordings"
        )
    lengths = [len(trajectory) for trajectory in trajectories]
    unused = sum(lengths) - len(lengths) * min(lengths)
    if unused:
        found.append(
            f"episodes last {min(lengths)} to {max(lengths)} steps: all are cut to the shortest, "
            f"{unused} of {sum(lengths)} steps are not used"
        )
    if min(lengths) < SHORTEST_STEPS:
        found.append(
            f"an episode has {min(lengths)} steps, `simtune tune` needs at least {SHORTEST_STEPS}"
        )
    return found + _of_actions(task, np.concatenate([t.actions for t in trajectories]))


def _of_actions(task: Task, actions: np.ndarray) -> list[str]:
    """Of (steps, A) actions that the model cuts off, or that tell nothing."""
    found, mapping = [], task.load_actions()
    for i, (low, high) in enumerate(zip(actions.min(0), actions.max(0), strict=True)):
        name, (least, most) = mapping.names[i], mapping.range[i]
        slack = 1e-3 * (most - least)
        if mapping.is_limited[i] and (low < least - slack or high > most + slack):
            found.append(
                f"actions of {name} go from {low:.4g} to {high:.4g}, beyond the model's range of "
                f"{least:g} to {most:g}, which cuts them off; are they in other units?"
            )
        if high - low <= 1e-6 * max(1.0, abs(high)):
            found.append(f"actions of {name} are always {high:.4g}: they excite nothing")
    return found
