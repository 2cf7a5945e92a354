"""How far off colours and their ratios are, in finished runs whose truth is known.

    simtune tune finger --real DIR/finger-a --budget-minutes 6 --out RUN
    python benchmarks/colours.py RUN ...

The truth is that of a pseudo-real world, or stands in truth.json beside recordings, see
recordings.py. Ratios are of two objects in one channel, with the intervals that draws of the run's
posterior have. Known colours count neither by themselves nor in ratios. The last line is one JSON
object.
"""

import json
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import machine, record_figures
from recordings import true_value

from simtune.parameters import Parameter
from simtune.tasks import load_task

_COLUMNS = {
    "task": "{task}",
    "real world": "{real}",
    "known colour": "{known}",
    "colours": "{colours_percent_error:.1f} %",
    "held": "{colours_held}",
    "ratios": "{ratios_percent_error:.1f} %",
    "ratios held": "{ratios_held}",
    "a ratio's half-width": "{ratios_half_width:.0f} %",
    "dynamics": "{dynamics_percent_error:.1f} %",
}


def main(
    runs: tyro.conf.Positional[tuple[Path, ...]] = (),
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Score them.

    Args:
        runs: Folders of finished runs of built-in tasks.
        record: Write the figures into this file of docs/results, too.
        quick: There need be no runs.
    """
    if not runs and not quick:
        raise SystemExit("which runs? give their folders")
    rows = [score(run) for run in runs]
    for row in rows:
        print(row)
    record_figures(record, ("task", "real", "known"), rows, _COLUMNS)
    print(json.dumps({"benchmark": "colours", "runs": rows, **machine()}))


def score(run: Path) -> dict[str, Any]:
    """A finished run's line: median errors in percent, and how many 90 % intervals hold."""
    result = json.loads((run / "result.json").read_text())
    config = json.loads((run / "config.json").read_text())["config"]
    task = load_task(config["task"])
    truth = _truth(config, result, list(task.parameters))
    known = {one.split("=")[0].strip() for one in (config.get("known_colour") or "").split(";")}
    colours = [p for p in task.parameters if p.is_colour and p.name[:-2] not in known]
    found = result["parameters"]
    error = {n: 100 * abs(found[n]["mean"] / value - 1) for n, value in truth.items()}
    holds = [found[p.name]["low"] <= truth[p.name] <= found[p.name]["high"] for p in colours]
    dynamics = [error[p.name] for p in task.parameters if not p.is_appearance]
    return {
        "task": task.name,
        "real": f"gap, seed {config['seed']}" if config["real_gap"] else Path(config["real"]).name,
        "known": config.get("known_colour") or "none",
        "colours_percent_error": _median([error[p.name] for p in colours]),
        "colours_held": f"{sum(holds)} of {len(holds)}",
        **_ratios(run, truth, colours),
        "dynamics_percent_error": _median(dynamics),
    }


def _truth(
    config: dict[str, Any], result: dict[str, Any], parameters: list[Parameter]
) -> dict[str, float]:
    """{parameter: true value}."""
    if config["real"] == "pseudo":
        return {p.name: result["parameters"][p.name]["real"] for p in parameters}
    entries = json.loads((Path(config["real"]) / "truth.json").read_text())
    return {p.name: true_value(entries[p.name], p.nominal) for p in parameters}


def _ratios(run: Path, truth: dict[str, float], colours: list[Parameter]) -> dict[str, Any]:
    """Of all pairs of one channel; nothing where there is none."""
    with np.load(run / "posterior.npz") as stored:
        drawn = dict(zip(stored["names"].tolist(), stored["draws"].T, strict=True))
    errors, holds, widths = [], [], []
    for one, other in combinations(colours, 2):
        if one.component == other.component:
            draws = drawn[one.name] / np.maximum(drawn[other.name], 1e-9)
            low, middle, high = np.quantile(draws, (0.05, 0.5, 0.95))
            true = truth[one.name] / truth[other.name]
            errors.append(100 * abs(middle / true - 1))
            holds.append(low <= true <= high)
            widths.append(50 * (high - low) / middle)
    if not errors:
        return {}
    return {
        "ratios_percent_error": _median(errors),
        "ratios_held": f"{sum(holds)} of {len(holds)}",
        "ratios_half_width": _median(widths),
    }


def _median(values: list[float]) -> float:
    return round(float(np.median(values)), 2)


if __name__ == "__main__":
    tyro.cli(main)
