"""What `simtune tune` makes of recordings whose truth is known, scored after it has ended.

A folder of recordings holds a LeRobotDataset v3 TASK-a for each task, with a truth.json beside
its data: {name: {"value": ..., "kind": ..., "ratio_to_nominal": ... (where it has one)}}.
A run that is finished already is scored again, not run again. Prints a table in Markdown; the
last line is one JSON object.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import machine, record_figures

from simtune.parameters import ParameterSpace
from simtune.real.truth import Truth
from simtune.tasks import TASKS, load_task

_SUFFIX = "-a"
_TUNE = (sys.executable, "-c", "from simtune.cli import main; main()", "tune")
_QUICK_TUNE = (sys.executable, "-m", "whole.variants", "--quick", "tune")  # found beside this file


def tune(task: str, recording: Path, out: Path, *options: str, quick: bool = False) -> bool:
    """Run it to its end, unless that was done before; whether it got there."""
    if (out / "result.json").exists():
        print(f"{out} is finished: scoring it", file=sys.stderr)
        return True
    command = [*(_QUICK_TUNE if quick else _TUNE), task]
    command += ["--real", str(recording), "--out", str(out), *options]
    print(f"tuning {task} to {recording}", file=sys.stderr)
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    return subprocess.run(command, stdout=sys.stderr, env=environment).returncode == 0


def true_value(entry: dict[str, Any], nominal: float) -> float:
    """A parameter in our units: a ratio holds whatever the nominal value was over there."""
    ratio = entry.get("ratio_to_nominal")
    return float(entry["value"] if ratio is None else ratio * nominal)


def score(result: dict[str, Any], truth: dict[str, Any], space: ParameterSpace) -> dict[str, Any]:
    """A run's errors and whether its intervals hold the truth, which itself is not told."""
    parameters, dynamics, colours = {}, [], []
    real_values = np.array([true_value(truth[p.name], p.nominal) for p in space])
    mean = np.array([result["parameters"][p.name]["mean"] for p in space])
    _, percent_errors = Truth(space, real_values).score(mean)
    for parameter, real, error in zip(space, real_values, percent_errors, strict=True):
        found, entry = result["parameters"][parameter.name], truth[parameter.name]
        (dynamics if "ratio_to_nominal" in entry else colours).append(error)
        parameters[parameter.name] = {
            "percent_error": round(float(error), 1),
            "covered": bool(found["low"] <= real <= found["high"]),
            **{key: found[key] for key in ("mean", "low", "high", "verdict")},
        }
    covered = [p["covered"] for p in parameters.values()]
    return {
        "percent_error": round(float(np.mean(dynamics + colours)), 1),
        "dynamics_percent_error": round(float(np.mean(dynamics)), 1) if dynamics else None,
        "colours_percent_error": round(float(np.mean(colours)), 1) if colours else None,
        "coverage": round(float(np.mean(covered)), 3),
        "wall_s": result["wall_s"],
        "real_episodes": result["real_episodes"],
        "parameters": parameters,
    }


def row(task: str, scored: dict[str, Any]) -> dict[str, Any]:
    """A task as docs/results shows it."""
    parameters = scored["parameters"]
    dynamics = [p.name for p in load_task(task).parameters if not p.is_colour]
    held = sum(p["covered"] for p in parameters.values())
    return {
        "task": task,
        "percent_error": scored["percent_error"],
        "coverage": scored["coverage"],
        "intervals_that_hold": f"{held} of {len(parameters)}",
        "dynamics_percent_error": {name: parameters[name]["percent_error"] for name in dynamics},
        "verdicts": {name: parameters[name]["verdict"] for name in dynamics},
    }


def print_table(scores: dict[str, dict[str, Any]]) -> None:
    print("| task | parameter | estimate | 90 % interval | holds the truth | error | verdict |")
    print("|---|---|---|---|---|---|---|")
    for task, scored in scores.items():
        for name, p in scored["parameters"].items():
            interval = f"{p['low']:.4g} to {p['high']:.4g}"
            covered = "yes" if p["covered"] else "no"
            print(
                f"| {task} | {name} | {p['mean']:.4g} | {interval} | {covered} "
                f"| {p['percent_error']:.1f} % | {p['verdict']} |"
            )
        held = f"{100 * scored['coverage']:.0f} %"
        print(f"| **{task}** | mean | | | {held} | **{scored['percent_error']:.1f} %** | |")


def tasks_in(recordings: Path) -> list[str]:
    """Those built-in tasks of which there is a recording with its truth."""
    return [t for t in TASKS if (recordings / f"{t}{_SUFFIX}" / "truth.json").is_file()]


def main(
    recordings: Path = Path("recordings"),
    tasks: tuple[str, ...] = (),
    out: Path = Path("runs/recordings"),
    budget_minutes: float = 8.0,
    real_episodes: int = 10,
    seed: int = 0,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        recordings: Folder of the recordings TASK-a.
        tasks: Which of them; by default all that are there.
        out: Folder for the runs' folders; what is finished there is not run again.
        budget_minutes: For each run.
        real_episodes: Recorded episodes to take.
        seed: Of all random numbers.
        record: Write the figures into this file of docs/results, too.
        quick: One run of a search that takes seconds and finds nothing; none without recordings.
    """
    found = tasks_in(recordings)
    if missing := [t for t in tasks if t not in found]:
        sys.exit(f"no {missing[0]}{_SUFFIX} with a truth.json in {recordings}")
    if not found:
        print(f"no recordings in {recordings}; give their folder by --recordings", file=sys.stderr)
        if not quick:
            sys.exit(2)
        print(json.dumps({"percent_error": None, "coverage": None, "tasks": None, **machine()}))
        return
    tasks = tasks or tuple(found)
    if quick:
        tasks, budget_minutes, real_episodes = tasks[:1], 0.1, 1
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) if quick else out
        asked = {"--budget-minutes": budget_minutes, "--real-episodes": real_episodes}
        options = [str(word) for pair in (asked | {"--seed": seed}).items() for word in pair]
        failed = run_all(recordings, tasks, out, options, record, quick)
    if failed:
        sys.exit(1)


def run_all(
    recordings: Path,
    tasks: tuple[str, ...],
    out: Path,
    options: list[str],
    record: Path | None,
    quick: bool,
) -> list[str]:
    """Tune and score each; print it all; the tasks whose runs failed."""
    scores, failed = {}, []
    for task in tasks:
        recording, run = recordings / f"{task}{_SUFFIX}", out / f"{task}{_SUFFIX}"
        if not tune(task, recording, run, *options, quick=quick):
            failed.append(task)
            continue
        result = json.loads((run / "result.json").read_text())
        truth = json.loads((recording / "truth.json").read_text())
        scores[task] = score(result, truth, load_task(task).parameters)
    print_table(scores)
    record_figures(record, ("task",), [row(task, scored) for task, scored in scores.items()])
    summary = {
        key: round(float(np.mean([s[key] for s in scores.values()])), 3) if scores else None
        for key in ("percent_error", "coverage")
    }
    print(json.dumps({**summary, "tasks": scores, "failed": failed, **machine()}))
    return failed


if __name__ == "__main__":
    tyro.cli(main)
