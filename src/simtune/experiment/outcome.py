"""The content of config.json, result.json, curves.json and metrics.jsonl."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from simtune.config import NO_RECORDINGS, TrainConfig, TuneConfig
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.real.truth import Truth
from simtune.run.files import plain
from simtune.tasks import AnyTask, Task
from simtune.tuning.combinations import combinations
from simtune.tuning.estimate import Estimate
from simtune.tuning.joint import Joint

# Fields of an estimate, beside its numbers
_IN_RESULT = ("correlations", "ranks", "held_out", "warnings", "latency_steps", "pictures_late_s")
_IN_RESULT += ("readings_late_s", "camera_responses")
_NAME_CONTENT = ("real", "real_parameters")  # options whose content is known later


def run_config(
    config: TuneConfig | TrainConfig,
    task: AnyTask,
    start: np.ndarray,
    real_metadata: Mapping[str, Any],
    truth: Truth | None,
) -> dict[str, Any]:
    """What config.json stores of a command: a run resumes only with the same.

    This includes the content of recordings, models, tuning files and a pseudo-real world's
    parameters, which may change in place.
    """
    dataset_hash = real_metadata.get("dataset_hash")
    contents = {
        "recordings": {"dataset_hash": dataset_hash} if dataset_hash else None,
        "truth": truth.digest if truth else None,
        "parameters": declared(task.parameters, start),
    }
    is_folder = config.real not in NO_RECORDINGS
    contents["real"] = _absolute(Path(config.real)) if is_folder else config.real
    contents["real_parameters"] = _absolute(config.real_parameters)
    return asked(config, task) | contents


def asked(config: TuneConfig | TrainConfig, task: AnyTask) -> dict[str, Any]:
    """The part of it that is known before the real world is read."""
    options = {k: _absolute(v) for k, v in asdict(config).items() if k not in _NAME_CONTENT}
    options |= {"task": task.source or config.task, "task_content": task.content_hash}
    options["task_name"] = task.name
    if isinstance(config, TuneConfig):
        options["precision"] = config.relative_precision  # 1 and 1% are the same
    if isinstance(config, TrainConfig) and isinstance(task, Task):
        options["policy_content"] = task.policy_hash
    return options


def _absolute(value: Any) -> Any:
    """An option as JSON; paths are made absolute."""
    return str(value.resolve()) if isinstance(value, Path) else value


def declared(space: ParameterSpace, start: np.ndarray) -> dict[str, dict[str, Any]]:
    """The parameters before any tuning, by name."""
    rows = zip(space, start, strict=True)
    return {
        p.name: {"unit": p.unit, "nominal": float(p.nominal), "initial": float(v)} for p, v in rows
    }


def result(
    metadata: Mapping[str, Any],
    space: ParameterSpace,
    start: np.ndarray,
    estimate: Estimate,
    truth: Truth | None,
    command: str | None = None,
) -> dict[str, Any]:
    """The content of result.json; the only place where an estimate is scored against a truth.

    `command`: what the user typed; None: the run was called from Python.
    """
    parameters, first = declared(space, start), Distribution.first(space, start)
    share = first.to_range_unit(estimate.high) - first.to_range_unit(estimate.low)
    for i, entry in enumerate(parameters.values()):
        entry["mean"] = float(estimate.mean[i])
        entry["low"], entry["high"] = float(estimate.low[i]), float(estimate.high[i])
        entry["verdict"], entry["interval_share"] = estimate.verdict[i], float(share[i])
    content: dict[str, Any] = {**metadata, "parameters": parameters}
    content |= plain({key: getattr(estimate, key) for key in _IN_RESULT})
    if command is not None:
        content["command"] = command
    if truth is not None:
        real, percent_error = truth.score(estimate.mean)
        for i, entry in enumerate(parameters.values()):
            entry["real"], entry["percent_error"] = float(real[i]), float(percent_error[i])
        content["percent_error"] = float(np.mean(percent_error))
    return content


def joint_posterior(joint: Joint, estimate: Estimate, draws: np.ndarray) -> dict[str, Any]:
    """The part of result.json on correlated parameters; `draws`: (num, N) of `joint`.

    "covariance" is in unit coordinates: 0 at a parameter's low bound, 1 at its high one, along its
    scale, so on a log scale they grow with the logarithm.
    """
    space, (mean, covariance) = joint.space, joint.mean_and_covariance()
    coordinates = [{"name": p.name, "scale": p.scale, "low": p.low, "high": p.high} for p in space]
    matrix = {"coordinates": coordinates, "mean": mean, "matrix": covariance}
    found = [asdict(c) for c in combinations(estimate, space, draws)]
    return plain({"covariance": matrix, "combinations": found})


def mean_and_spread(values: np.ndarray) -> dict[str, float]:
    """Mean and spread of (n,) episodes' returns, or of whether they reached a goal."""
    return {"mean": float(values.mean()), "std": float(values.std()), "episodes": len(values)}


def scalars(ranges: Distribution, estimate: Estimate) -> dict[str, float]:
    """A round's estimates, and the ranges that are searched next, for a line of metrics.jsonl."""
    columns = {"mean": estimate.mean, "low": estimate.low, "high": estimate.high}
    columns |= {"range_low": ranges.low, "range_high": ranges.high}
    return {
        f"{column}/{name}": float(value)
        for column, values in columns.items()
        for name, value in zip(ranges.space.names, values, strict=True)
    }


def curves(estimate: Estimate) -> dict[str, dict[str, Any]]:
    """The content of curves.json."""
    return {n: {"candidates": c, "prob_higher": p} for n, (c, p) in estimate.curves.items()}
