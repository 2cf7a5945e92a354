"""Carries out the runs that have no line yet."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from simtune.tasks import TASKS
from whole.lines import Line, Lines, begun, failure
from whole.parallel import carry_out_all, usable_cores
from whole.run import Ended, Stopped, WholeRun, carry_out
from whole.variants import VARIANTS


def check_tasks(tasks: Sequence[str]) -> None:
    """Exits where there is no such task."""
    if unknown := [t for t in tasks if t not in (*TASKS, *VARIANTS)]:
        sys.exit(f"no task {unknown[0]!r}; there are: {', '.join((*TASKS, *VARIANTS))}")


@dataclass(frozen=True, kw_only=True)
class Measurement:
    known: Lines
    out: Path  # for the runs' folders
    score: Callable[[WholeRun, Ended], Line]  # of a run that ended well
    keep: bool = False  # the runs' folders

    def carry_out(self, asked: Sequence[WholeRun], jobs: int) -> None:
        """At most `jobs` at a time. Exits where a run needs more cores than there are."""
        ids, missing = usable_cores(), [run for run in asked if not self.known.has(run)]
        if too_many := [run.cores for run in missing if run.cores > len(ids)]:
            sys.exit(f"a run shall have {too_many[0]} cores, but there are {len(ids)}")
        print(f"{len(missing)} of {len(asked)} runs are to be done", file=sys.stderr)
        carry_out_all(missing, jobs, ids, self._carry_out)

    def _carry_out(self, run: WholeRun, cores: list[int], stop: Event) -> None:
        line = begun(run)
        try:
            ended = carry_out(run, self.out / run.name, cores, stop, self.keep)
        except Stopped:
            print(f"{run.name} was stopped; the same command runs it again", file=sys.stderr)
            return
        found = failure(ended) if ended.failed else self.score(run, ended)
        self.known.append(run.task, line | found)
        said = ended.failed or f"mean error {ended.result['percent_error']:.2f} %"
        print(f"{run.name}, {ended.wall_s:.0f} s: {said}", file=sys.stderr, flush=True)
