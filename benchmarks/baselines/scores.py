"""The figures of benchmarks/accuracy.py: what its runs' result.json files say together."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from baselines.one_run import BASELINES, SEARCHES
from simtune.parameters import ParameterSpace
from simtune.run.files import read_json
from simtune.tasks import TASKS, load_task

_WITH_INTERVALS = ("posterior", "npe", "sysid")  # the low and high of others mean no interval
_COLUMNS = (
    "task",
    "method",
    "worlds",
    "mean error",
    "its 90th percentile",
    "median error of each dynamics parameter",
    "90 % intervals that hold the truth",
    "real episodes",
    "simulated steps",
    "seconds",
)

Results = dict[tuple[str, str], list[dict[str, Any]]]  # of the worlds, by task and method


def read_results(out: Path) -> Results:
    """All that is finished in there."""
    return {
        (task, method): results
        for task in TASKS
        for method in (*SEARCHES, *BASELINES)
        if (results := [read_json(p) for p in sorted(out.glob(f"{task}-*-{method}/result.json"))])
    }


def mean_errors(results: Iterable[Mapping[str, Any]]) -> np.ndarray:
    """(worlds,) the mean percent error over the parameters that were estimated."""
    return np.array(
        [np.mean([p["percent_error"] for p in r["parameters"].values()]) for r in results]
    )


def score(method: str, results: list[dict[str, Any]], space: ParameterSpace) -> dict[str, Any]:
    """One line of the table: medians over worlds."""
    errors = mean_errors(results)
    dynamics = [p.name for p in space if not p.is_colour]
    entries = [p for r in results for p in r["parameters"].values()]
    covered = [p["low"] <= p["real"] <= p["high"] for p in entries if p["low"] is not None]
    return {
        "worlds": len(results),
        "percent_error": float(np.median(errors)),
        "percent_error_p90": float(np.percentile(errors, 90)),
        "dynamics_percent_error": {
            name: float(np.median([r["parameters"][name]["percent_error"] for r in results]))
            for name in dynamics
        },
        "coverage": float(np.mean(covered)) if covered and method in _WITH_INTERVALS else None,
        "real_episodes": int(np.median([r["real_episodes"] for r in results])),
        "sim_steps": int(np.median([r["sim_steps"] for r in results])),
        "wall_s": float(np.median([r["wall_s"] for r in results])),
    }


def score_all(results: Results) -> dict[str, dict[str, dict[str, Any]]]:
    """{task: {method: score}}"""
    scores: dict[str, dict[str, dict[str, Any]]] = {}
    for (task, method), worlds in results.items():
        scored = score(method, worlds, load_task(task).parameters)
        scores.setdefault(task, {})[method] = scored
    return scores


def table(scores: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """In Markdown, a line a task and method."""
    lines = [_line(_COLUMNS), _line(["---"] * len(_COLUMNS))]
    for task, methods in scores.items():
        lines += [_line(_cells(task, method, scored)) for method, scored in methods.items()]
    return "\n".join(lines) + "\n"


def _cells(task: str, method: str, scored: Mapping[str, Any]) -> list[str]:
    dynamics = scored["dynamics_percent_error"].items()
    coverage = scored["coverage"]
    return [
        task,
        method + (" (true states; no colours)" if method == "sysid" else ""),
        str(scored["worlds"]),
        f"{scored['percent_error']:.1f} %",
        f"{scored['percent_error_p90']:.1f} %",
        ", ".join(f"{name} {error:.1f} %" for name, error in dynamics),
        "–" if coverage is None else f"{100 * coverage:.0f} %",
        str(scored["real_episodes"]),
        f"{scored['sim_steps']:,}",
        f"{scored['wall_s']:.0f}",
    ]


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
