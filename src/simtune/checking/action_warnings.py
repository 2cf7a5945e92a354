"""Possible mistakes in recorded actions: those of a controller, another order, other units."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simtune.checking.doubt import Doubt, grouped
from simtune.recordings.controllers import named_in
from simtune.recordings.source import short
from simtune.tasks import AnyTask
from simtune.units import GAIN_OF_DEGREES

_FAR_IN_RANGES = 5.0  # what may be degrees, not a clipped command
_AS_DEGREES = (
    f', such as degrees? Then mapping = "scaled" and gain = {GAIN_OF_DEGREES} in [actions]'
)


def action_warnings(
    task: AnyTask, facts: Mapping[str, Any], recorded: Sequence[np.ndarray]
) -> list[str]:
    """On the actions (T, A) of a dataset's episodes, which has these facts."""
    return [
        *_of_controller(task, facts, recorded),
        *_of_order(facts.get("action_names", ()), task.load_actions().names),
        *_of_sizes(task, np.concatenate(recorded)),
    ]


def _of_controller(
    task: AnyTask, facts: Mapping[str, Any], recorded: Sequence[np.ndarray]
) -> list[str]:
    """On actions that look like those of a controller which the recordings name.

    Such a controller takes numbers from -1 to 1; torques and positions of arms are larger.
    """
    own_scale = max(np.abs(actions).max(initial=0) for actions in recorded)
    if own_scale > 1 or task.load_actions().is_relative:
        return []
    controller = named_in(Path(facts.get("folder", "")))
    return [f"actions may not be what actuators are sent: {controller}"] if controller else []


def _of_order(recorded: Sequence[str], own: Sequence[str]) -> list[str]:
    """On the names of recorded actions beside the task's own, which they are taken for in turn."""
    theirs, ours = ([_plain(name) for name in names] for names in (recorded, own))
    if theirs == ours or sorted(theirs) != sorted(ours):
        return []
    in_order = [recorded[theirs.index(name)] for name in ours]
    return [
        f"recorded actions are named as the task's, but in another order ({short(list(recorded))}; "
        f"the task's are {short(list(own))}), and they are taken in their own: say --actions "
        f"{','.join(in_order)}"
    ]


def _plain(name: str) -> str:
    """A name without what recorders add to it."""
    return name.lower().removesuffix(".pos").removeprefix("main_").replace("/", "_")


def _of_sizes(task: AnyTask, actions: np.ndarray) -> list[str]:
    """On (steps, A) actions that the model clips, or that tell nothing."""
    far, still, mapping = [], [], task.load_actions()
    for i, (low, high) in enumerate(zip(actions.min(0), actions.max(0), strict=True)):
        name, (least, most) = mapping.names[i], mapping.range[i]
        slack = 1e-3 * (most - least)
        if mapping.is_limited[i] and (low < least - slack or high > most + slack):
            begins, ends = np.rad2deg([least - slack, most + slack])
            may_be = (
                begins < low
                and high < ends
                and max(-low, high) > _FAR_IN_RANGES * max(-least, most)
            )
            says = (
                f"actions of {name} go from {low:.4g} to {high:.4g}, beyond the model's range of "
                f"{least:g} to {most:g}, which cuts them off; are they in other units"
                + (_AS_DEGREES if may_be else "?")
            )
            far.append(Doubt(says, "range", name))
        if high - low <= 1e-6 * max(1.0, abs(high)):
            still.append((name, high))
    found = grouped(far)
    if len(still) == 1:
        name, value = still[0]
        found.append(f"actions of {name} are always {value:.4g}: they excite nothing")
    elif still:
        found.append(
            f"{len(still)} of {len(mapping.names)} actions never change "
            f"({short([name for name, _ in still])}): they excite nothing, so parameters of what "
            "only they would move cannot be told"
        )
    return found
