"""What is kept of runs: TASK.jsonl in a folder, a line each, written whole as soon as it ends."""

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from common import commit

from simtune.parameters import ParameterSpace
from simtune.run.files import append_jsonl, keep_lines, read_jsonl
from whole.run import Ended, WholeRun

_DIGITS = 4  # of figures: lines are committed, and should be small
_SETTINGS = ("task", "seed", "cores", "minutes", "episodes", "gap", "precision", "observe")

Line = dict[str, Any]


class Lines:
    """A run with a line, also of its failure, counts as done; delete the line to repeat it."""

    def __init__(self, folder: Path):
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def of(self, task: str) -> list[Line]:
        return read_jsonl(self._path(task))

    def of_run(self, run: WholeRun) -> list[Line]:
        """None or one, unless the same was measured at the same time by two commands."""
        asked = [run.settings.get(key) for key in _SETTINGS]
        return [x for x in self.of(run.task) if [x.get(key) for key in _SETTINGS] == asked]

    def has(self, run: WholeRun) -> bool:
        return bool(self.of_run(run))

    def append(self, task: str, line: Mapping[str, Any]) -> None:
        path = self._path(task)
        if path.exists() and not path.read_bytes().endswith(b"\n"):
            keep_lines(path, len(read_jsonl(path)))  # a crash left half a line
        append_jsonl(path, line)

    def _path(self, task: str) -> Path:
        return self._folder / f"{task}.jsonl"


def begun(run: WholeRun) -> Line:
    """What a line holds before its run: asked at its start, since code may change meanwhile."""
    return run.settings | {"commit": commit(), "date": date.today().isoformat()}


def failure(ended: Ended) -> Line:
    return {"wall_s": round(ended.wall_s, 1), "failed": ended.failed}


def scored(ended: Ended, space: ParameterSpace) -> Line:
    """Errors and half-widths in percent of the truth, whether intervals hold, what it said."""
    assert ended.result is not None
    found = ended.result["parameters"]
    size = {p.name: max(abs(found[p.name]["real"]), 0.01 * abs(p.high)) for p in space}
    half_widths = {n: 50 * (e["high"] - e["low"]) / size[n] for n, e in found.items()}
    return {
        "wall_s": round(ended.wall_s, 1),
        "rounds": sum("round" in row for _, row in ended.rounds),
        "errors": {name: figure(entry["percent_error"]) for name, entry in found.items()},
        "half_widths": {name: figure(width) for name, width in half_widths.items()},
        "holds": {name: e["low"] <= e["real"] <= e["high"] for name, e in found.items()},
        "verdicts": {name: entry["verdict"] for name, entry in found.items()},
        "warnings": ended.result["warnings"],
    }


def figure(value: float) -> float:
    """With as many digits as mean something."""
    return float(np.format_float_positional(value, _DIGITS, unique=False, fractional=False))
