"""How much faster two workers carry out a sweep than one does.

The runs are `simtune tune` in processes of their own, with short episodes and a search of seconds
that finds nothing (`whole/variants.py`); nothing in them is limited by time. The last line is one
JSON object.
"""

import json
import os
import sys
import tempfile
import time
from pathlib import Path

import tyro
from common import machine, record_figures

from simtune.config import SweepConfig
from simtune.sweep import sweep

_BENCHMARKS = Path(__file__).parent
_PROGRAM = (sys.executable, "-m", "whole.variants", "--quick")
_GRID = """
[[runs]]
command = "tune"
task = "cartpole"
real_episodes = 1
budget_minutes = 10
seed = {seeds}
"""
_COLUMNS = {
    "runs": "{runs}",
    "one worker": "{one_worker_s:.0f} s",
    "two workers": "{two_workers_s:.0f} s",
    "of one worker's time": "{share:.2f}",
    "load at the start": "{load:.1f}",
}


def main(runs: int = 40, record: Path | None = None, quick: bool = False) -> None:
    """Measure it.

    Args:
        runs: So many, once by each number of workers.
        record: Write the figures into this file of docs/results, too.
        quick: Two runs.
    """
    runs = 2 if quick else runs
    paths = [str(_BENCHMARKS.parent / "src"), str(_BENCHMARKS), os.environ.get("PYTHONPATH")]
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    load = os.getloadavg()[0]
    # On a machine that others use: two in the middle, so that a drift of its load cancels.
    half, two_s = _seconds(runs // 2, 1), _seconds(runs, 2)
    one_s = half + _seconds(runs - runs // 2, 1)
    figures = {"runs": runs, "one_worker_s": one_s, "two_workers_s": two_s, "share": two_s / one_s}
    figures["load"] = load
    record_figures(record, ("runs",), [figures], _COLUMNS)
    print(json.dumps({"benchmark": "sweep", "quick": quick, **machine(), **figures}))


def _seconds(runs: int, workers: int) -> float:
    """Wall time of a whole sweep in a new folder. Exits where a run failed."""
    with tempfile.TemporaryDirectory() as folder:
        grid = Path(folder) / "grid.toml"
        grid.write_text(_GRID.format(seeds=list(range(runs))))
        began_s = time.monotonic()
        standings = sweep(
            SweepConfig(grid=grid, out=Path(folder) / "sweep", workers=workers), _PROGRAM
        )
        wall_s = time.monotonic() - began_s
    if failed := [s.reason for s in standings.values() if s.status != "done"]:
        sys.exit(f"{len(failed)} runs failed: {failed[0]}")
    return wall_s


if __name__ == "__main__":
    tyro.cli(main)
