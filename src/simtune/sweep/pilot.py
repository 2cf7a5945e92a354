"""Pilots, which measure how long a run of each kind takes: done once, kept in pilots.json."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from simtune.config import TuneConfig
from simtune.experiment.presets import choose_schedule, choose_search
from simtune.run.files import read_json, read_jsonl, write_json
from simtune.run.stored import read_result
from simtune.sweep.asked import AskedRun
from simtune.sweep.lease import Lease, cores_taken
from simtune.sweep.process import Processes
from simtune.sweep.standing import Places
from simtune.tasks import load_task


@dataclass(frozen=True)
class Pilot:
    """Estimated time of a kind of run."""

    wall_s: float | None  # None: the pilot ended before an estimate was possible
    how: str  # basis of the estimate, in words
    limit_s: float | None = None  # at which the pilot was cut short; None: it was a whole run


class Pilots:
    """The pilots in a sweep's folder, by kind of run."""

    def __init__(self, folder: Path):
        self._file = folder / "pilots.json"
        known: dict[str, Any] = read_json(self._file) if self._file.exists() else {}
        self._known = {kind: Pilot(**fields) for kind, fields in known.items()}

    def get(self, kind: str) -> Pilot | None:
        return self._known.get(kind)

    def missing(self, runs: Iterable[AskedRun], limit_s: float) -> list[AskedRun]:
        """The first run of each kind without a pilot, or with one that was cut short sooner."""
        first = {run.kind: run for run in reversed(list(runs))}
        return [run for kind, run in first.items() if self._is_missing(kind, limit_s)]

    def _is_missing(self, kind: str, limit_s: float) -> bool:
        pilot = self._known.get(kind)
        return pilot is None or (pilot.limit_s is not None and pilot.limit_s < limit_s)

    def add(self, kind: str, pilot: Pilot) -> None:
        self._known[kind] = pilot
        write_json(self._file, {kind: asdict(known) for kind, known in self._known.items()})


def measure(
    run: AskedRun,
    folder: Path,
    processes: Processes,
    cores_per_run: int,
    limit_s: float,
    say: Callable[[str], None],
) -> Pilot:
    """Carry out a run for at most `limit_s` seconds, in the sweep's folder of pilots.

    It goes on where an earlier one was stopped.
    """
    places = Places(folder, run.name, kind="pilots")
    places.make_folders()
    if not (lease := Lease.take(places.lease)):
        return Pilot(None, "another process measures it", limit_s=0.0)
    try:
        with cores_taken(cores_per_run, say, is_over=lambda: processes.is_stopped) as cores:
            began_s, arguments = time.monotonic(), run.arguments(places.run)
            _, lines = processes.run(arguments, places.log, lease, cores, limit_s)
    finally:
        lease.close()
    if (result := read_result(places.run)) is not None:
        # A run that went on knows of the time before.
        return Pilot(max(time.monotonic() - began_s, result.get("wall_s", 0.0)), "a whole run")
    return _extrapolate(run, places.run, limit_s, lines)


def _extrapolate(run: AskedRun, folder: Path, limit_s: float, lines: Sequence[str]) -> Pilot:
    """Estimate the time of a whole run from one that was killed."""
    config = run.config()
    if isinstance(config, TuneConfig):
        return Pilot(60 * config.budget_minutes, "its budget, at most", limit_s)
    schedule = choose_schedule(config, load_task(run.values["task"]), choose_search(config))
    steps = [line for line in read_jsonl(folder / "metrics.jsonl") if line["step"] > 0]
    if steps:
        share = steps[-1]["step"] / schedule.total_steps
        how = f"the first {100 * share:.0f} % of its steps"
        return Pilot(steps[-1]["wall_s"] / share, how, limit_s)
    last_line = lines[-1] if lines else "it said nothing"
    return Pilot(None, f"it had not begun to train its policy: {last_line}", limit_s)
