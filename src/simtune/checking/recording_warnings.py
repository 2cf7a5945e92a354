"""Possible problems of recordings, before anything is learnt from them."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simtune.checking.action_warnings import action_warnings
from simtune.columns import episode_in_words
from simtune.errors import InputError
from simtune.fit import FEWEST_STEPS
from simtune.names import DEFAULT_SEARCH, search_traits
from simtune.recordings.unused_steps import of_lengths, of_unfilmed
from simtune.search_param_model.posterior_net import SHORTEST_STEPS
from simtune.tasks import AnyTask, Task
from simtune.trajectory import Trajectory

_MAX_LATE_SHARE = 0.3  # of a step: the simulator films exactly at each step's end
_FAST_READINGS_RATIO = 1.95  # two a step, by a clock that is a little off
_SPARE_S, _SPARE_SHARE = 1.0, 0.2  # of the actions' time: a camera usually stops so soon after them


def recording_warnings(
    task: AnyTask,
    facts: Mapping[str, Any],
    recorded: Sequence[np.ndarray],
    num_replayed: int,
    search: str | None = DEFAULT_SEARCH,
) -> list[str]:
    """Sentences on recordings that a task's worlds are to replay.

    `facts` are a dataset's, `recorded` the actions (T, A) of its episodes, of which the first
    `num_replayed` would be tuned to by this `search`.
    """
    found = []
    control_hz, task_hz = facts["control_hz"], 1 / task.step_s
    step_ms = 1e3 / control_hz
    largest_ms = max((c["time_error_ms"]["largest"] for c in facts["cameras"]), default=0.0)
    are_late = largest_ms > _MAX_LATE_SHARE * step_ms
    is_chosen = not math.isclose(control_hz, facts.get("fps", control_hz))  # by --control-hz
    if abs(control_hz / task_hz - 1) > 0.01 and not is_chosen:
        found.append(
            f"recordings are replayed at {control_hz:.4g} steps/s, the task has {task_hz:.4g}; the "
            "simulator follows them"
            # More steps would be farther from frames that are late already
            + f", --control-hz {task_hz:.4g} brings them to it. Was {control_hz:.4g} Hz the real "
            "rate? A wrong one in the file makes all motion too fast or too slow"
            * (not are_late or task_hz < control_hz)
        )
    if are_late:
        found.append(
            f"frames are up to {largest_ms:.3g} ms away from their steps of {step_ms:.3g} ms: "
            f"motion will seem to stand still and jump. {_against_late(facts['cameras'], step_ms)}"
            + "; --observe joints uses every reading, at the logged rate"
            * bool(isinstance(task, Task) and task.sensors)
        )
    found += _of_fast_readings(facts)
    found += _of_gaps(facts.get("gaps", {})) + _of_clocks(facts.get("unused_s", {}))
    found += of_unfilmed(facts.get("unfilmed", {}))
    if search_traits(search).cuts_to_shortest:
        lengths = [len(actions) for actions in recorded[:num_replayed]]
        if facts["cameras"]:  # readings use all steps
            found += of_lengths(lengths, facts.get("names", ()), facts.get("names_left_out", ()))
        found += _of_short(lengths, facts.get("names", ()), are_filmed=bool(facts["cameras"]))
    return found + action_warnings(task, facts, recorded)


def trajectory_warnings(
    task: AnyTask,
    facts: Mapping[str, Any],
    trajectories: Sequence[Trajectory],
    search: str | None,
) -> list[str]:
    """The same for a real world with such `facts`; none if it is no recording."""
    if "cameras" not in facts:
        return []
    return recording_warnings(
        task, facts, [t.actions for t in trajectories], len(trajectories), search
    )


def _against_late(cameras: Sequence[Mapping[str, Any]], step_ms: float) -> str:
    """What brings frames nearer to steps."""
    if frame_ms := max((camera.get("frame_ms") or 0.0 for camera in cameras), default=0.0):
        return (
            f"Frames come every {frame_ms:.3g} ms (median), steps every {step_ms:.3g} ms: if each "
            f"video lasts as long as its actions, take --control-hz {1e3 / frame_ms:.3g} or less"
        )
    return (
        "Frames come about as often as steps, or more often, but not when these begin: more frames "
        "a second bring them nearer, or a row that is logged with each frame"
    )


def _of_fast_readings(facts: Mapping[str, Any]) -> list[str]:
    """On readings of which most fall between two steps, at a rate that nobody chose."""
    steps_hz, readings_hz = facts["control_hz"], facts.get("readings_hz", 0.0)
    is_own = math.isclose(steps_hz, facts.get("fps", steps_hz))
    if facts["cameras"] or not is_own or readings_hz < _FAST_READINGS_RATIO * steps_hz:
        return []
    return [
        f"readings come at {readings_hz:.4g} Hz, steps are {steps_hz:.4g} Hz: "
        f"--control-hz {readings_hz:.4g} uses all of them (each step takes as long)"
    ]


def _of_gaps(gaps: Mapping[str, Sequence[tuple[float, float]]]) -> list[str]:
    """On gaps between rows, {episode: (start, end) of each, seconds}; one line for all."""
    lasts = [(end - start, name, start, end) for name in gaps for start, end in gaps[name]]
    if not lasts:
        return []
    _, name, start, end = max(lasts)
    of_several = f", the longest of {len(lasts)} gaps" if len(lasts) > 1 else ""
    return [
        f"{name}: no row between {start:.4g} and {end:.4g} s{of_several}: the action before is "
        "held; was the log cut?"
    ]


def _of_clocks(unused: Mapping[str, tuple[float, float]]) -> list[str]:
    """On videos that go on after the last action, {episode: (for how long, its length)} in s."""
    long = [(ends_s, lasts_s, name) for name, (ends_s, lasts_s) in unused.items()]
    long = [one for one in long if one[0] > max(_SPARE_S, _SPARE_SHARE * one[1])]
    if not long:
        return []
    ends_s, lasts_s, name = max(long)
    return [
        f"{name}: the video goes on for {ends_s:.3g} s after {lasts_s:.3g} s of actions, and is "
        "not used there; are the times in the table counted from the video's first frame?"
    ]


def _of_short(lengths: list[int], names: Sequence[str], *, are_filmed: bool) -> list[str]:
    """On episodes of these numbers of steps, and with these names, that are too short to use."""
    if min(lengths) >= (least := _fewest_steps(are_filmed=are_filmed)):
        return []
    episode = episode_in_words(names, lengths.index(min(lengths)))
    return [
        f"{episode} has {min(lengths)} steps: `simtune tune` needs at least {least} of each, "
        "so leave it out (--leave-out)"
    ]


def long_enough(recorded: Sequence[np.ndarray], *, are_filmed: bool) -> list[np.ndarray]:
    """Actions (T, A) of the episodes that could be tuned to. Raises InputError if there are none.

    The others are warned of.
    """
    least = _fewest_steps(are_filmed=are_filmed)
    if found := [actions for actions in recorded if len(actions) >= least]:
        return found
    raise InputError(
        f"no episode has the {least} steps that `simtune tune` needs, the longest has "
        f"{max(map(len, recorded))}: record longer ones, or take more steps/s (--control-hz)"
    )


def too_short(num_steps: int, *, are_filmed: bool) -> list[str]:
    """On simulated episodes."""
    if num_steps >= (least := _fewest_steps(are_filmed=are_filmed)):
        return []
    return [f"episodes have {num_steps} steps, `simtune tune` needs at least {least}"]


def _fewest_steps(*, are_filmed: bool) -> int:
    """Of an episode that can be tuned to."""
    return SHORTEST_STEPS if are_filmed else FEWEST_STEPS
