"""How a run's estimates compare with a world's parameters."""

from typing import Any

import numpy as np

from simtune.real.truth import Truth
from simtune.tasks import Task
from two_arms.world import World


def score(task: Task, world: World, result: dict[str, Any]) -> dict[str, Any]:
    """Percent errors, and whether 90 % intervals hold, of what the method has an estimate of."""
    found, space = result["parameters"], task.parameters
    mean = np.array([found[n]["mean"] if n in found else np.nan for n in space.names])
    real, percent = Truth(space, world.parameters).score(mean)
    parameters = {}
    for name, true, error in zip(space.names, real, percent, strict=True):
        if name in found:
            low, high = (found[name][end] for end in ("low", "high"))  # null: no interval
            parameters[name] = {
                "percent_error": round(float(error), 1),
                "holds": None if low is None else bool(low <= true <= high),
                "verdict": found[name].get("verdict"),
                "true": float(true),
                **{key: found[name][key] for key in ("mean", "low", "high")},
            }
    return {
        "seconds": round(result["wall_s"]),
        "warnings": result["warnings"],
        "parameters": parameters,
    }


def rows(task: Task, seed: int, scores: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """One a parameter, and one of the time; a column a method."""
    rows: list[dict[str, Any]] = []
    for name in task.parameters.names:
        row: dict[str, Any] = {"world": seed, "parameter": name}
        for method, its_score in scores.items():
            its = its_score["parameters"].get(name)
            row[method.replace(".", "_")] = _words(its) if its else "–"
        rows.append(row)
    seconds = {m.replace(".", "_"): f"{of['seconds']} s" for m, of in scores.items()}
    return [*rows, {"world": seed, "parameter": "time", **seconds}]


def _words(its: dict[str, Any]) -> str:
    """Error, half of the interval in percent of the estimate, whether that holds, and a verdict."""
    words = [f"{its['percent_error']} %"]
    if its["holds"] is None:
        words.append("no interval")
    elif its["verdict"] != "not identifiable":
        half = 50 * (its["high"] - its["low"]) / max(abs(its["mean"]), 1e-9)
        words.append(f"±{half:.2g} % {'holds' if its['holds'] else '**misses**'}")
    return ", ".join([*words, *filter(None, [its["verdict"]])])


def print_table(rows: list[dict[str, Any]]) -> None:
    columns = [key for key in rows[0] if key != "world"]
    print("| " + " | ".join(columns) + " |")
    print("|" + "---|" * len(columns))
    for row in rows:
        print("| " + " | ".join(str(row.get(key, "–")) for key in columns) + " |")
