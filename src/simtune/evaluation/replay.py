"""`simtune evaluate RUN --real DIR`: other recordings, replayed open loop in a tuned simulator."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from simtune.before_after.readings import Replayed, Tuned, replay
from simtune.checking.replayed_contacts import in_words, touching
from simtune.columns import cut
from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.fit.readings.readings import travel
from simtune.observation import assumed_noise, finds_offset
from simtune.real.observed import observed, open_recordings
from simtune.real.recorded import RecordedReal
from simtune.run_data import RunData, finished, read_run
from simtune.tasks import Task, with_model
from simtune.trajectory import Trajectory
from simtune.validate import is_number

_SMALLEST_PX = 1  # nothing is drawn
_MOST_NAMED = 5  # readings
# Of what a replay's scores say
_KEPT = "unit", "rms_before", "rms", "diverged_before", "diverged"
_FAR = 10.0  # times what a run leaves of its own recordings, or the sensor's noise


def evaluate_replay(run_folder: Path, recordings: Path, num_episodes: int | None) -> dict[str, Any]:
    """{"sensors": {joint: its unit, rms before and after tuning, better_in}, "episodes"}.

    `better_in`: the number of episodes that are replayed better after tuning. Where the run was
    tuned to readings, "rms_tuned_to" is what it leaves of those, and "far_off" names readings of
    which far more is left here; "far_episodes" those where it is, and "touching" says what touches
    in their replays. "astray" names readings of which more is left than they travel. "no_offset"
    names readings whose offset it does not know. Where replays diverge, their number is each
    reading's "diverged_before" and "diverged"; a root mean square over none is None.

    Raises InputError for a task without joint readings, or recordings that do not match it.
    """
    run = read_run(run_folder)
    task = _readable(run, run_folder)
    real = _open(run, task, recordings)
    trajectories = real.collect(num_episodes or real.num_episodes)
    replayed = _replay(run, task, real, trajectories)
    if early := only_early(replayed):
        raise InputError(
            f"{recordings}: no reading of {cut(early, _MOST_NAMED)} is later than the delay that "
            "the run found; expected some: give longer episodes, or such as have later readings"
        )
    less_left, scores = better_in(replayed), replayed.scores()
    sensors = {
        name: {key: its[key] for key in _KEPT if key in its} | {"better_in": less_left[name]}
        for name, its in scores.items()
    }
    for name, facts in run.readings.items():
        if is_number(facts.get("rms")):
            sensors[name]["rms_tuned_to"] = facts["rms"]
    joints = real.observation.sensors
    finds = zip(replayed.labels, finds_offset(joints), strict=True)
    noise = dict(zip(replayed.labels, assumed_noise(joints).tolist(), strict=True))
    far = far_off(sensors, noise)
    is_far = far_episodes(replayed, far, sensors, noise)
    names = [real.facts["names"][episode] for episode in np.flatnonzero(is_far)]
    return {
        "sensors": sensors,
        "episodes": len(trajectories),
        "far_off": far,
        "far_episodes": names,
        "astray": astray(replayed, noise),
        "touching": _touching(replayed, is_far, names),
        "no_offset": [n for n, is_found in finds if is_found and n not in run.readings],
    }


def _readable(run: RunData, folder: Path) -> Task:
    """The task of a finished run. Raises InputError if nothing is read in it."""
    refused = InputError(
        f"{folder} has no joint readings to replay: --real goes with a finished run of "
        "`simtune tune` whose tuning file has [[sensors]], also one of video alone"
    )
    if "latency_steps" not in run.result and "sensors" not in run.result:
        raise refused
    task = with_model(finished(run).load_task())
    if not task.sensors:
        raise refused
    return task


def _replay(
    run: RunData, task: Task, real: RecordedReal, trajectories: list[Trajectory]
) -> Replayed:
    """Before tuning and after it."""
    parameters, space = run.parameters, task.parameters
    start, mean = (np.array([parameters[n][k] for n in space.names]) for k in ("initial", "mean"))
    offsets = {name: facts["offset"] for name, facts in run.readings.items()}
    simulator = task.simulator(image_size=_SMALLEST_PX, step_s=real.step_s, views=())
    tuned = Tuned(mean, offsets, *_late(run, real.step_s))
    return replay(simulator, real.observation, trajectories, start, tuned)


def only_early(replayed: Replayed) -> list[str]:
    """Readings that never come after a replay has begun, but for those that diverge."""
    played = [e for e in range(len(replayed.after)) if e not in replayed.diverged]
    compared = np.isfinite(replayed.after - replayed.measured)[played]
    early = [name for i, name in enumerate(replayed.labels) if not compared[..., i].any()]
    return early if played else []


def far_off(sensors: Mapping[str, Mapping[str, Any]], noise: Mapping[str, float]) -> list[str]:
    """Readings of which far more is left than in the recordings that the run was tuned to.

    `noise`: of each reading; what is below some times that is not far, whatever is left of others.
    """
    return [
        name
        for name, its in sensors.items()
        if is_number(its.get("rms"))
        and is_number(its.get("rms_tuned_to"))
        and its["rms"] >= _FAR * max(its["rms_tuned_to"], noise[name])
    ]


def far_episodes(
    replayed: Replayed,
    far: Sequence[str],
    sensors: Mapping[str, Mapping[str, Any]],
    noise: Mapping[str, float],
) -> np.ndarray:
    """(E,) bool: those in which readings that are `far` off are so."""
    columns = [replayed.labels.index(name) for name in far]
    left = (replayed.after - replayed.measured)[..., columns]
    much = [_FAR * max(sensors[name]["rms_tuned_to"], noise[name]) for name in far]
    known = np.isfinite(left).sum(1)
    is_far = (known > 0) & (np.nansum(np.square(left), 1) >= np.square(much) * known)
    return is_far.any(-1)


def _touching(replayed: Replayed, chosen: np.ndarray, names: Sequence[str]) -> str:
    """What touches in replays of the episodes that (E,) bool chooses, and that have these names."""
    if replayed.tuned is None or not chosen.any():
        return ""
    found = touching(*replayed.tuned.of(chosen))
    return in_words(found, names) if found else ""


def astray(replayed: Replayed, noise: Mapping[str, float]) -> list[str]:
    """Readings that move, and of which more is left than they travel in any episode."""
    travels, left = travel(replayed.measured).max(0).tolist(), replayed.scores()
    return [
        name
        for name, its in zip(replayed.labels, travels, strict=True)
        if (left[name]["rms"] or 0.0) > its > _FAR * noise[name]
    ]


def better_in(replayed: Replayed) -> dict[str, int]:
    """{reading: the number of episodes in which less is left after tuning, where both replay}.

    All is left where replays before tuning diverge.
    """
    of_both = np.stack([replayed.before, replayed.after]) - replayed.measured
    of_both[0, list(replayed.diverged_before)] = np.inf
    known = ~np.isnan(of_both).any(0)
    before, after = np.where(known, np.square(of_both), 0).sum(2)
    return dict(zip(replayed.labels, (after < before).sum(0).tolist(), strict=True))


def _late(run: RunData, step_s: float) -> tuple[int, float]:
    """Whole steps of `step_s`, and seconds, of the delay that the run found at its own rate."""
    steps, (late_s, _) = (run.result[key] for key in ("latency_steps", "readings_late_s"))
    own_s = run.replay.get("step_s") or run.result["step_s"]
    if own_s == step_s:
        return steps, late_s
    total_s = steps * own_s + late_s
    whole = max(0, round(total_s / step_s))
    return whole, total_s - whole * step_s


def _open(run: RunData, task: Task, recordings: Path) -> RecordedReal:
    """All episodes, with the run's other options; readings only.

    Of the sensors that the run looked at, or else of all.
    """
    options = {f.name: run.config[f.name] for f in fields(TuneConfig) if f.name in run.config}
    options |= {"out": run.path, "real": str(recordings), "leave_out": None}
    config = TuneConfig(**options)
    names = tuple(sensor.name for sensor in task.sensors)
    asked = set(config.observed or ())
    if "joints" not in asked:
        names = tuple(name for name in names if name in asked) or names
    seen = observed(task, names, is_simulated=False)
    return RecordedReal(open_recordings(recordings, task, config, _SMALLEST_PX, seen), seen)
