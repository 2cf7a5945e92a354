"""What a tuning run writes down: config.json, metrics, checkpoints, curves.json, result.json."""

import shlex
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from simtune.config import TrainConfig
from simtune.parameters import ParameterSpace
from simtune.real.truth import Truth
from simtune.tasks import AnyTask, Task
from simtune.tuning.search import Estimate, Search

_TOLD = ("correlations", "ranks", "warnings")  # of an estimate, beside its numbers
_KEPT = ("verdict", *_TOLD, "start", "lag")


def asked(
    config: Any,
    task: AnyTask,
    start: np.ndarray,
    real_facts: Mapping[str, Any],
    truth: Truth | None,
) -> dict[str, Any]:
    """What config.json remembers of a command: a run goes on only with the same.

    That holds for the content of recordings, models, tuning files and a pseudo-real world's
    parameters too, which may change where they lie.
    """
    settings = {k: str(v) if isinstance(v, Path) else v for k, v in asdict(config).items()}
    known = real_facts.get("dataset_hash")
    content = {"dataset_hash": known} if known else None
    parameters = declared(task.parameters, start)
    contents = {"recordings": content, "task_content": task.content_hash}
    contents["truth"] = truth.digest if truth else None
    if isinstance(config, TrainConfig) and isinstance(task, Task):
        contents["policy_content"] = task.policy_hash
    return {**settings, **contents, "parameters": parameters}


def recordings(real_facts: Mapping[str, Any]) -> dict[str, Any]:
    """What result.json says of recordings; nothing where there are none."""
    return {"recordings": real_facts} if real_facts else {}


def declared(space: ParameterSpace, start: np.ndarray) -> dict[str, dict[str, Any]]:
    """The parameters as they are before any tuning, by name."""
    rows = zip(space, start, strict=True)
    return {
        p.name: {"unit": p.unit, "nominal": float(p.nominal), "initial": float(v)} for p, v in rows
    }


def result(
    facts: Mapping[str, Any],
    space: ParameterSpace,
    start: np.ndarray,
    estimate: Estimate,
    truth: Truth | None,
) -> dict[str, Any]:
    """The content of result.json. The only place where a truth is looked at."""
    parameters = declared(space, start)
    for i, entry in enumerate(parameters.values()):
        entry["mean"] = float(estimate.mean[i])
        entry["low"], entry["high"] = float(estimate.low[i]), float(estimate.high[i])
        entry["verdict"] = estimate.verdict[i]
    content: dict[str, Any] = {**facts, "parameters": parameters}
    content |= {key: getattr(estimate, key) for key in _TOLD}
    if Path(sys.argv[0]).name == "simtune":  # called from Python there is no command
        content["command"] = shlex.join(["simtune", *sys.argv[1:]])
    if truth is not None:
        real, percent_error = truth.score(estimate.mean)
        for i, entry in enumerate(parameters.values()):
            entry["real"], entry["percent_error"] = float(real[i]), float(percent_error[i])
        content["percent_error"] = float(np.mean(percent_error))
    return content


def summary(values: np.ndarray) -> dict[str, float]:
    """Of (n,) episodes' returns, or of whether they reached a goal."""
    return {"mean": float(values.mean()), "std": float(values.std()), "episodes": len(values)}


def scalars(search: Search, estimate: Estimate) -> dict[str, float]:
    """An iteration's estimates and ranges, as a line of metrics.jsonl has them."""
    ranges = search.distribution
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


def to_json(estimate: Estimate) -> dict[str, Any]:
    """An estimate as a checkpoint holds it."""
    arrays = {key: getattr(estimate, key).tolist() for key in ("mean", "low", "high")}
    pairs = {name: (c.tolist(), p.tolist()) for name, (c, p) in estimate.curves.items()}
    kept = {key: getattr(estimate, key) for key in _KEPT}
    return {**arrays, **kept, "curves": pairs}


def from_json(saved: Mapping[str, Any]) -> Estimate:
    """The inverse of `to_json`."""
    arrays = {key: np.array(saved[key]) for key in ("mean", "low", "high")}
    pairs = {name: (np.array(c), np.array(p)) for name, (c, p) in saved["curves"].items()}
    kept = {key: saved[key] for key in _KEPT}
    return Estimate(**arrays, **kept, curves=pairs)
