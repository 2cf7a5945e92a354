"""How near the truth: simtune's search over random worlds, and what people would use instead.

World k of a task has random dynamics (×½ to ×2 of nominal) and random colours; it is filmed,
and tuned to from a start at ×2/×½ of each parameter. By default the posterior search, over all
tasks. The other methods look at the same videos, simulate at most as many steps, for as long:

    paper, regression   the paper's search and its baseline, in simtune
    npe                 sbi's neural posterior estimation with a CNN embedding
    cmaes               CMA-ES on the pixels of replayed actions
    sysid               mujoco.sysid, given the true states: a bound that privileged data sets

The last three need `pip install --group bench`; benchmarks/baselines says how each is used.
Runs that are finished in OUT are not run again, so the same command goes on; the table and the
picture are of all that OUT holds. The last line is one JSON object.
"""

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from queue import SimpleQueue

import tyro
from baselines.one_run import Method, OneRun
from baselines.picture import draw
from baselines.scores import read_results, score_all, table
from common import machine, record_figures

from simtune.tasks import TASKS

_NEEDED = {"npe": "sbi", "cmaes": "cma", "sysid": "plotly"}  # a module of the group `bench`


def main(
    tasks: tuple[str, ...] = ("ball_in_cup", "walker", "cheetah", "finger", "cartpole"),
    worlds: int = 5,
    methods: tuple[Method, ...] = ("posterior",),
    minutes: float = 10.0,
    real_episodes: int = 5,
    jobs: int = 2,
    out: Path = Path("runs/accuracy"),
    gap: bool = False,
    far: bool = False,
    picture: Path | None = None,
    record: Path | None = None,
    quick: bool = False,
) -> None:
    """Measure it.

    Args:
        tasks: Which of the built-in ones.
        worlds: Random worlds of each.
        methods: Which methods; run the posterior search first, it sets the others' budgets.
        minutes: At most so long for each run.
        real_episodes: Episodes of the real world that each run looks at.
        jobs: Runs at a time, each on a core of its own; 1: one run on all cores.
        out: Folder for the runs' folders, table.md and accuracy.png.
        gap: Through a reality gap (simtune tune --real-gap); results go to OUT/gap.
        far: Starts at ×4/×¼; results go to OUT/far.
        picture: Write the picture there, too.
        record: Write the figures into this file of docs/results, too.
        quick: One run of a search that takes seconds and finds nothing.
    """
    if unknown := [t for t in tasks if t not in TASKS]:
        sys.exit(f"no task {unknown[0]!r}; there are: {', '.join(TASKS)}")
    if missing := [m for m in methods if m in _NEEDED and not find_spec(_NEEDED[m])]:
        sys.exit(f"{missing[0]} needs more packages: pip install --group bench")
    variant = "-".join(name for name, asked in (("gap", gap), ("far", far)) if asked)
    with tempfile.TemporaryDirectory() as temporary:
        if quick:
            tasks, worlds, methods, jobs = tasks[:1], 1, methods[:1], 1
            minutes, real_episodes, out = 0.1, 1, Path(temporary)
        out = out / variant
        runs = [
            OneRun(
                out=str(out),
                task=task,
                world=world,
                method=method,
                minutes=minutes,
                real_episodes=real_episodes,
                gap=gap,
                far=far,
                quick=quick,
            )
            for world in range(worlds)  # so that an unfinished table is a fair one
            for task in tasks
            for method in methods
        ]
        failed = run_all(runs, jobs)
        summarize(out, variant, failed, picture, record)
    if failed:
        sys.exit(1)


def run_all(runs: list[OneRun], jobs: int) -> list[str]:
    """Carry out those that are not finished, the posterior searches first; which failed."""
    cores: SimpleQueue[int | None] = SimpleQueue()
    mine = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [None]
    for job in range(jobs):
        cores.put(mine[job % len(mine)] if jobs > 1 else None)

    def carry_out(run: OneRun) -> bool:
        core = cores.get()
        try:
            return run_one(run, core)
        finally:
            cores.put(core)

    failed = []
    with ThreadPoolExecutor(jobs) as pool:
        for first in (True, False):
            part = [run for run in runs if (run.method == "posterior") == first]
            part = [run for run in part if not run.result.exists()]
            done = pool.map(carry_out, part)
            failed += [r.folder.name for r, well in zip(part, done, strict=True) if not well]
    return failed


def run_one(run: OneRun, core: int | None) -> bool:
    """Carry it out in a process of its own, on one core if that is given; whether it went well."""
    print(f"running {run.folder}", file=sys.stderr, flush=True)
    environment = {**os.environ, "OMP_WAIT_POLICY": "PASSIVE"}
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]  # where the baselines are
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    if core is not None:
        environment["OMP_NUM_THREADS"] = "1"
    asked = json.dumps({**asdict(run), "core": core})
    log = run.folder.parent / "logs" / f"{run.folder.name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("a") as lines:
        command = [sys.executable, "-m", "baselines.one_run", asked]
        process = subprocess.run(command, stdout=lines, stderr=lines, env=environment)
    if process.returncode:
        print(f"{run.folder.name} failed: see {log}", file=sys.stderr)
    return process.returncode == 0


def summarize(
    out: Path, variant: str, failed: list[str], picture: Path | None, record: Path | None
) -> None:
    """Print and write what all finished runs say together."""
    results = read_results(out)
    scores = score_all(results)
    if results:
        (out / "table.md").write_text(table(scores))
        print(table(scores))
        start = "×4/×¼" if "far" in variant else "×2/×½"
        through = ", through a reality gap" if "gap" in variant else ""
        title = f"Errors from a start at {start}{through}: a dot a world, bars at medians"
        for path in filter(None, (out / "accuracy.png", picture)):
            draw(results, path, title)
    rows = [
        {"task": task, "method": method, **scored}
        for task, methods in scores.items()
        for method, scored in methods.items()
    ]
    record_figures(record, ("task", "method"), rows)
    print(json.dumps({"variant": variant, "scores": scores, "failed": failed, **machine()}))


if __name__ == "__main__":
    tyro.cli(main)
