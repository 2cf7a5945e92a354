"""Pilots, which measure how long a run of each kind takes: done once, kept in pilots.json."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from simtune.config import TuneConfig
from simtune.presets import choose_schedule, choose_search
from simtune.run import read_json, read_jsonl, write_json
from simtune.sweep.asked import AskedRun
from simtune.sweep.lease import Lease, cores_taken
from simtune.sweep.process import Processes
from simtune.sweep.standing import Places, read_result
from simtune.tasks import load_task


@dataclass(frozen=True)
class Pilot:
    """Estimated time of a kind of run."""

    wall_s: float | None  # None: the pilot ended before an estimate was possible
    how: str  # basis of the estimate, in words


class Pilots:
    """The pilots in a sweep's folder, by kind of run."""

    def __init__(self, folder: Path):
        self._file = folder / "pilots.json"
        known: dict[str, Any] = read_json(self._file) if self._file.exists() else {}
        self._known = {kind: Pilot(**fields) for kind, fields in known.items()}

    def get(self, kind: str) -> Pilot | None:
        return self._known.get(kind)

    def missing(self, runs: Iterable[AskedRun]) -> list[AskedRun]:
        """The first run of each kind without a pilot."""
        first = {run.kind: run for run in reversed(list(runs))}
        return [run for kind, run in first.items() if kind not in self._known]

    def add(self, kind: str, pilot: Pilot) -> None:
        self._known[kind] = pilot
        write_json(self._file, {kind: asdict(known) for kind, known in self._known.items()})


def measure(
    run: AskedRun, folder: Path, processes: Processes, cores_per_run: int, limit_s: float
) -> Pilot:
    """Carry out a run for at most `limit_s` seconds, in the sweep's folder of pilots."""
    places = Places(folder, run.name, kind="pilots")
    places.make_folders()
    if not (lease := Lease.take(places.lease)):
        return Pilot(None, "another process measures it")
    try:
        with cores_taken(cores_per_run, is_over=lambda: processes.is_stopped) as cores:
            began_s, arguments = time.monotonic(), run.arguments(places.run)
            _, lines = processes.run(arguments, places.log, lease, cores, limit_s)
    finally:
        lease.close()
    return _judge(run, places.run, time.monotonic() - began_s, lines)


def _judge(run: AskedRun, folder: Path, spent_s: float, lines: Sequence[str]) -> Pilot:
    """Estimate the time of a whole run from one that ended, or was killed, after `spent_s`."""
    if read_result(folder) is not None:
        return Pilot(spent_s, "a whole run")
    config = run.config()
    if isinstance(config, TuneConfig):
        return Pilot(60 * config.budget_minutes, "its budget, at most")
    schedule = choose_schedule(config, load_task(run.values["task"]), choose_search(config))
    steps = [line for line in read_jsonl(folder / "metrics.jsonl") if line["step"] > 0]
    if steps:
        share = steps[-1]["step"] / schedule.total_steps
        return Pilot(spent_s / share, f"the first {100 * share:.0f} % of its steps")
    last_line = lines[-1] if lines else "it said nothing"
    return Pilot(None, f"it had not begun to train its policy: {last_line}")
