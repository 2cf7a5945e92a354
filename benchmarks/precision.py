"""Seconds from nothing until a world is known to 1 % on average, with intervals.

Each run is the plain `simtune tune` in a process of its own, on the goals' two cores with nothing
beside. The clock runs from the process's start, so that imports and filming count. Once a
simulator is fitted, and again when known worlds have judged that, the command writes its estimates
and intervals; the first with intervals of all parameters whose mean error is small enough stops
the clock, and the first judged one is told as well. Only the scoring knows the
truth, so the command itself goes on for as long as it would. Lines, and what is not run again, are
as in whole_runs.py. The last line is one JSON object.
"""

import json
import math
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import kept_in, machine, record_figures
from whole.lines import Line, Lines, figure
from whole.measure import Measurement, check_tasks
from whole.run import Ended, WholeRun
from whole.summary import failures, median_s, origin
from whole.truths import draw
from whole.variants import load

from simtune.parameters import ParameterSpace
from simtune.real.truth import Truth

GOALS_S = {"ball_in_cup": 120, "cartpole": 120, "finger": 120, "cheetah": 180, "walker": 180}

_COLUMNS = {
    "task": "{task}",
    "worlds": "{worlds}",
    "known so well in": "{reached}",
    "seconds until then": "{seconds}",
    "until judged": "{judged_s}",
    "goal": "{goal_s}",
    "seconds to goal": "{ratio}",
    "seconds of the whole command": "{returned_s}",
    "held then": "{held_then:.0%}",
    "held at the end": "{held:.0%}",
}


def main(
    tasks: tuple[str, ...] = tuple(GOALS_S),
    worlds: int = 3,
    seeds_from: int = 0,
    percent: float = 1.0,
    precision: float | None = None,
    minutes: float = 8.0,
    real_episodes: int = 5,
    cores: int = 2,
    out: Path = Path("runs/precision"),
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        tasks: Built-in ones, or walker_links.
        worlds: Random worlds of each.
        seeds_from: The first world's number.
        percent: The mean error to reach.
        precision: The command's --precision; by default its own.
        minutes: Its --budget-minutes.
        real_episodes: Of each world, 200 steps each.
        cores: Of each run; one run at a time.
        out: Folder for the lines and the runs' folders.
        record: Write the figures into this file of docs/results, too.
        quick: One run of a search that takes seconds and finds nothing; nothing is kept.
    """
    if quick:
        tasks, worlds, minutes, cores = ("cartpole",), 1, 0.1, 1
    check_tasks(tasks)
    with kept_in(out, quick) as folder:
        asked = [
            WholeRun(
                task=task,
                seed=seed,
                cores=cores,
                minutes=minutes,
                episodes=real_episodes,
                precision=precision,
                quick=quick,
            )
            for seed in range(seeds_from, seeds_from + worlds)
            for task in tasks
        ]
        known = Lines(folder)
        Measurement(known=known, out=folder, score=followed).carry_out(asked, jobs=1)
        rows, failed = [], []
        for task in tasks:
            own = [line for run in asked if run.task == task for line in known.of_run(run)]
            rows.append({"task": task, "percent": percent} | summary(own, percent))
            failed += failures(own)
            print(rows[-1], file=sys.stderr)
    measured = [row for row in rows if row["worlds"]]
    record_figures(record, ("task", "percent"), measured, _COLUMNS)
    about = {"benchmark": "precision", "quick": quick, **machine()}
    print(json.dumps({**about, "tasks": rows, "failed": failed}))
    if failed:
        sys.exit(1)


def followed(run: WholeRun, ended: Ended) -> Line:
    """When each round ended, its mean error in percent, and whether its intervals hold."""
    assert ended.result is not None
    space = load(run.task).parameters
    truth = draw(run.task, space, run.seed)
    found = ended.result["parameters"].values()
    return {
        "wall_s": round(ended.wall_s, 1),
        "rounds": [scored_round(seconds, row, space, truth) for seconds, row in ended.rounds],
        "percent_error": figure(ended.result["percent_error"]),
        "held": sum(e["low"] <= e["real"] <= e["high"] for e in found),
        "of": len(space),
        "load": round(os.getloadavg()[0], 2),  # a minute's, at its end: of this run alone?
    }


def scored_round(
    seconds: float, row: Mapping[str, Any], space: ParameterSpace, truth: Mapping[str, float]
) -> dict[str, Any]:
    """Of a line of metrics.jsonl; `held` is None where a parameter has no interval yet."""
    mean = np.array([row[f"mean/{name}"] for name in space.names], float)
    _, errors = Truth(space, space.from_dict(truth)).score(mean)
    held = None
    if has_intervals(row, space.names):
        ends = [(row[f"low/{name}"], truth[name], row[f"high/{name}"]) for name in space.names]
        held = sum(low <= value <= high for low, value, high in ends)
    error = figure(errors.mean())
    is_judged = not row.get("is_early", False)
    return {"s": round(seconds, 1), "percent_error": error, "held": held, "is_judged": is_judged}


def has_intervals(row: Mapping[str, Any], names: Sequence[str]) -> bool:
    """Whether a round gave every parameter an interval."""
    ends = [row.get(f"{end}/{name}") for end in ("low", "high") for name in names]
    return all(end is not None and math.isfinite(end) for end in ends)


def known_at(line: Line, percent: float, judged: bool = False) -> dict[str, Any] | None:
    """The first answer with intervals whose mean error is at most so large; None: there is none.

    `judged`: the first that known worlds have judged.
    """
    rounds = (r for r in line["rounds"] if r["held"] is not None and (r["is_judged"] or not judged))
    return next((r for r in rounds if r["percent_error"] <= percent), None)


def summary(lines: Sequence[Line], percent: float) -> dict[str, Any]:
    """Of one task: medians over its worlds; one that is never known so well is the slowest."""
    done = [line for line in lines if "failed" not in line]
    figures: dict[str, Any] = {"worlds": len(done), "failed": len(lines) - len(done)}
    if not done:
        return figures
    reached = [known_at(line, percent) for line in done]
    seconds, goal_s = median_s([r and r["s"] for r in reached]), GOALS_S.get(done[0]["task"])
    judged = [known_at(line, percent, judged=True) for line in done]
    then = [(r["held"], line["of"]) for r, line in zip(reached, done, strict=True) if r]
    return figures | {
        "reached": f"{len(then)} of {len(done)}",
        "seconds": seconds,
        "judged_s": median_s([r and r["s"] for r in judged]),
        "goal_s": goal_s,
        "ratio": figure(seconds / goal_s) if seconds and goal_s else None,
        "returned_s": median_s([line["wall_s"] for line in done]),
        "held_then": _share(then) if then else None,
        "held": _share([(line["held"], line["of"]) for line in done]),
        "percent_error": figure(float(np.median([line["percent_error"] for line in done]))),
        **origin(done),
    }


def _share(counts: Sequence[tuple[int, int]]) -> float:
    held, of = map(sum, zip(*counts, strict=True))
    return round(held / of, 3)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that its run ends as well
    tyro.cli(main)
