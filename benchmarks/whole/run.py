"""One run of `simtune tune`, in a process of its own, as a user would type it."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from signal import SIGINT, SIGTERM
from threading import Event
from typing import Any

from simtune.run.files import read_json, read_jsonl, write_json
from simtune.tasks import TASKS
from whole.truths import draw
from whole.variants import load

_BENCHMARKS = Path(__file__).parents[1]
_LOOK_EVERY_S = 0.25  # whether another round has ended
_LONGEST_REASON = 300  # characters of a failure that are kept


@dataclass(frozen=True, kw_only=True)
class WholeRun:
    task: str
    seed: int  # of the truth, the start and everything else
    cores: int  # it may run on
    minutes: float
    episodes: int
    gap: bool = False
    precision: float | None = None  # percent; None: the command's own
    observe: str | None = None  # None: as the task has it, its camera alone
    quick: bool = False  # a search of seconds that finds nothing

    @property
    def name(self) -> str:
        return "-".join([self.task, str(self.seed), *[self.observe] * (self.observe is not None)])

    @property
    def settings(self) -> dict[str, Any]:
        """By which a line is known as this run's; None is left out."""
        return {k: v for k, v in asdict(self).items() if v is not None and k != "quick"}

    def command(self, world: Path, out: Path) -> list[str]:
        program = [str(Path(sys.executable).with_name("simtune"))]
        if self.quick or self.task not in TASKS:
            program = [sys.executable, "-m", "whole.variants", *["--quick"] * self.quick]
        options = ["--real-parameters", str(world), "--real-episodes", str(self.episodes)]
        options += ["--budget-minutes", str(self.minutes), "--seed", str(self.seed)]
        options += ["--out", str(out), *["--real-gap"] * self.gap]
        if self.observe is not None:
            options += ["--observe", self.observe]
        if self.precision is not None:
            options += ["--precision", str(self.precision)]
        return [*program, "tune", self.task, *options]


@dataclass(frozen=True)
class Ended:
    """What came of a run."""

    wall_s: float  # from the process's start to its end
    rounds: list[tuple[float, dict[str, Any]]]  # seconds from that start, a line of metrics.jsonl
    result: dict[str, Any] | None  # result.json
    failed: str | None  # why there is none


class Stopped(Exception):
    """The run was interrupted from outside, which says nothing about it."""


def carry_out(
    run: WholeRun, folder: Path, cores: Sequence[int], stop: Event, keep: bool = False
) -> Ended:
    """Run it on these cores, in a new `folder` that is removed afterwards unless it is to be kept.

    Binds the calling thread to the cores, too. Raises Stopped where it was ended from outside, or
    `stop` is set.
    """
    shutil.rmtree(folder, ignore_errors=True)  # a killed run's: going on with it would save time
    folder.mkdir(parents=True)
    try:
        write_json(folder / "world.json", draw(run.task, load(run.task).parameters, run.seed))
        return _carry_out(run, folder, cores, stop)
    finally:
        if not keep:
            shutil.rmtree(folder)


def _carry_out(run: WholeRun, folder: Path, cores: Sequence[int], stop: Event) -> Ended:
    out, log = folder / "run", folder / "log.txt"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)  # of this thread only; the process it starts inherits it
    with log.open("w") as lines:
        began_s = time.monotonic()
        process = subprocess.Popen(
            run.command(folder / "world.json", out), stdout=lines, stderr=lines, env=_environment()
        )
        try:
            rounds = _watch(process, out / "metrics.jsonl", began_s, stop)
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
        wall_s = time.monotonic() - began_s
    if process.returncode == 0:
        return Ended(wall_s, rounds, read_json(out / "result.json"), None)
    reason = last_line(log.read_text(errors="replace"))
    # A terminal's Ctrl-C reaches the command as well, which then says so and exits with 1.
    interrupted = reason.startswith("simtune: interrupted")
    if interrupted or stop.is_set() or process.returncode in (-SIGINT, -SIGTERM):
        raise Stopped(run.name)
    return Ended(wall_s, rounds, None, f"exit status {process.returncode}: {reason}")


def _watch(
    process: subprocess.Popen[bytes], metrics: Path, began_s: float, stop: Event
) -> list[tuple[float, dict[str, Any]]]:
    """When each round's line was written, until the process ends or `stop` is set."""
    rounds: list[tuple[float, dict[str, Any]]] = []
    while True:
        ended = process.poll() is not None  # before reading, so that no last line is missed
        now_s = time.monotonic() - began_s
        rounds += [(now_s, row) for row in read_jsonl(metrics)[len(rounds) :]]
        if ended or stop.wait(_LOOK_EVERY_S):
            return rounds


def _environment() -> dict[str, str]:
    """So that the code beside this file runs, whose commit is written down."""
    paths = [str(_BENCHMARKS.parent / "src"), str(_BENCHMARKS), os.environ.get("PYTHONPATH")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def last_line(text: str) -> str:
    """The last line that says anything, cut where it is long."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:_LONGEST_REASON] if lines else "it said nothing"
