"""Do 90 % intervals hold the truth, in whole runs of `simtune tune`?

Each run is the plain command in a process of its own, on one core or two. Its world, its start and
its seed follow from its number: dynamics within ×½ to ×2 of nominal, colours in [.25, 1], a start
at ×2 or ×½. What came of it is a line in LINES/TASK.jsonl as soon as it ends, and its folder is
removed. The same command goes on where it was stopped: runs with a line, also of a failure, are
not run again. Lines of other settings or commits in the same files are left alone, so give other
`--lines` or `--seeds-from` for changed code.

walker_links is walker with one mass each for the torso, the thighs and the legs. The last line is
one JSON object.
"""

import json
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

import tyro
from common import machine, record_figures
from whole.lines import Line, Lines, scored
from whole.measure import Measurement, check_tasks
from whole.run import Ended, WholeRun
from whole.summary import failures, summary
from whole.variants import load

_COLUMNS = {
    "task": "{task}",
    "minutes": "{minutes:g}",
    "looked at": "{observe}",
    "runs": "{runs}",
    "held": "{coverage:.0%}",
    "least held": "{lowest:.0%}",
    "less than half held, no warning": "{wrong_unwarned:.0%}",
    "dynamics": "{dynamics_percent_error:.2f} %",
    "colours": "{colours_percent_error:.2f} %",
    "identified, but more than 10 % off": "{identified_far_off}",
    "time to budget, at most": "{wall_to_budget:.2f}",
}


def main(
    tasks: tuple[str, ...] = ("ball_in_cup", "walker", "cheetah", "finger", "cartpole"),
    runs: int = 30,
    seeds_from: int = 0,
    minutes: float = 6.0,
    real_episodes: int = 5,
    cores_per_run: Literal["1", "2", "half"] = "1",
    jobs: int = 2,
    gap: bool = False,
    observe: str | None = None,
    out: Path = Path("runs/whole_runs"),
    lines: Path | None = None,
    keep: bool = False,
    show: bool = False,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        tasks: Built-in ones, or walker_links.
        runs: Of each task.
        seeds_from: The first run's number; another one draws worlds that nobody has seen.
        minutes: Each run's --budget-minutes.
        real_episodes: Of each world, 200 steps each (the arm's: 60).
        cores_per_run: half: runs of even numbers have one core, others two.
        jobs: Runs at a time, as far as cores suffice: each has its own.
        gap: Through a reality gap (simtune tune --real-gap).
        observe: Also readings: cameras,joints (simtune tune --observe).
        out: Folder for the runs' folders.
        lines: Folder for the lines; by default OUT.
        keep: Leave the runs' folders there.
        show: Run nothing, and say what the lines that are there say.
        record: Write the figures into this file of docs/results, too.
        quick: One run of a search that takes seconds and finds nothing; nothing is kept.
    """
    with tempfile.TemporaryDirectory() as temporary:
        if quick:
            tasks, runs, cores_per_run, jobs = ("cartpole",), 1, "1", 1
            minutes, out, lines, keep = 0.1, Path(temporary), None, False
        check_tasks(tasks)
        asked = [
            WholeRun(
                task=task,
                seed=seed,
                cores=_cores_of(seed, cores_per_run),
                minutes=minutes,
                episodes=real_episodes,
                gap=gap,
                observe=observe,
                quick=quick,
            )
            for seed in range(seeds_from, seeds_from + runs)  # so that what is there is balanced
            for task in tasks
        ]
        known = Lines(lines or out)
        if not show:
            Measurement(known=known, out=out, score=_score, keep=keep).carry_out(asked, jobs)
        summarize(asked, known, record, quick)


def _cores_of(seed: int, cores_per_run: str) -> int:
    return 1 + seed % 2 if cores_per_run == "half" else int(cores_per_run)


def _score(run: WholeRun, ended: Ended) -> Line:
    return scored(ended, load(run.task).parameters)


def summarize(asked: list[WholeRun], known: Lines, record: Path | None, quick: bool) -> None:
    """Print what all runs say together, and record it. Exits with 1 where a run failed."""
    rows, failed = [], []
    for task in dict.fromkeys(run.task for run in asked):
        own = [line for run in asked if run.task == task for line in known.of_run(run)]
        failed += failures(own)
        figures = summary(own, load(task).parameters)
        first = asked[0]
        settings: dict[str, Any] = {"task": task, "minutes": first.minutes, "gap": first.gap}
        settings["observe"] = first.observe or "cameras"
        rows.append(settings | figures)
        print(f"{task}: {figures}", file=sys.stderr)
    measured = [row for row in rows if row["runs"]]
    record_figures(record, ("task", "minutes", "gap", "observe"), measured, _COLUMNS)
    for what in failed:
        print(f"failed: {what}", file=sys.stderr)
    about = {"benchmark": "whole_runs", "quick": quick, **machine()}
    print(json.dumps({**about, "tasks": rows, "failed": failed}))
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that its runs end as well
    tyro.cli(main)
