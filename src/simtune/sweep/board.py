"""Progress of a sweep: sweep.json, a live table on a terminal, and plain lines elsewhere."""

import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from threading import Lock
from typing import Any

from simtune.columns import aligned
from simtune.report.words import duration
from simtune.run.files import read_json, write_json
from simtune.sweep.asked import AskedRun
from simtune.sweep.estimate import Expectation, seconds_left
from simtune.sweep.lease import Lease
from simtune.sweep.pilot import Pilots
from simtune.sweep.process import NO_ROOM
from simtune.sweep.standing import Places, Standing

FILE = "sweep.json"
_COLUMNS = ("done", "running", "waiting", "failed")


def read_entries(folder: Path) -> list[dict[str, Any]]:
    """Runs that sweep.json names, perhaps of other grids.

    Raises OSError, ValueError, KeyError or TypeError if it is damaged.
    """
    file = folder / FILE
    return read_json(file)["runs"] if file.exists() else []


class Board:
    """Shows the progress; `begin` and `end` may be called from any thread."""

    def __init__(self, folder: Path, runs: Sequence[AskedRun], retries: int, workers: int):
        self._folder, self._runs, self._workers = folder, runs, workers
        self.standings = {run.name: Places(folder, run.name).standing(retries) for run in runs}
        self._pilots = Pilots(folder)
        self._running = dict[str, float]()
        self._lock = Lock()
        self._drawn = 0
        self._is_live = sys.stderr.isatty()
        self._write()

    def begin(self, run: AskedRun) -> None:
        with self._lock:
            self._running[run.name] = time.monotonic()
            self._draw()

    def end(self, run: AskedRun, standing: Standing) -> None:
        with self._lock:
            self._running.pop(run.name, None)
            self.standings[run.name] = standing
            self._write()
            why = f", {standing.reason}" if standing.status == "failed" else ""
            self._print(f"{run.name}: {standing.status}{why}")
            if not self._is_live:
                self._print(self._total())
            self._draw()

    def say(self, words: str) -> None:
        with self._lock:
            self._print(words)
            self._draw()

    @property
    def seconds_left(self) -> float | None:
        expected = Expectation(self._runs, self.standings, self._pilots)
        left_s, now_s = list[float | None](), time.monotonic()
        for run in self._runs:
            if self.standings[run.name].status == "waiting":
                whole_s = expected[run]
                spent_s = now_s - self._running.get(run.name, now_s)
                left_s.append(None if whole_s is None else whole_s - spent_s)
        return seconds_left(left_s, self._workers)

    def _total(self) -> str:
        counts = Counter(standing.status for standing in self.standings.values())
        left = "unknown" if self.seconds_left is None else f"about {duration(self.seconds_left)}"
        failed = f", {counts['failed']} failed" if counts["failed"] else ""
        return f"{counts['done']} of {len(self._runs)} runs done{failed}; time left: {left}"

    def table(self, most: int = sys.maxsize) -> list[str]:
        """Lines: number of runs by status, for each task and method, and a line for all.

        At most `most`: then those of what is running, or waits, come first.
        """
        groups: dict[str, Counter[str]] = {}
        for run in self._runs:
            method = run.options.get("method", run.command)
            status = "running" if run.name in self._running else self.standings[run.name].status
            groups.setdefault(f"{run.task} {method}", Counter())[status] += 1
        kept, more = list(groups.items()), list[str]()
        if len(kept) + 2 > most:  # the heading, and the line for all
            kept.sort(key=lambda group: (not group[1]["running"], not group[1]["waiting"]))
            kept = kept[: max(most - 3, 0)]
            more = [f"and {len(groups) - len(kept)} rows more"]
        rows: list[tuple[str, ...]] = [("", *_COLUMNS)]
        for name, counts in kept:
            rows.append((name, *(str(counts[column] or "·") for column in _COLUMNS)))
        return [*aligned(rows, left=[0]), *more, self._total()][-most:]

    def _write(self) -> None:
        """Replace sweep.json. If the disk is full, the old one stays until the next time."""
        entries = [self.standings[run.name].entry(run) for run in self._runs]
        try:
            with Lease.awaited(self._folder / "state" / "board.lock"):
                others = [e for e in read_entries(self._folder) if e["name"] not in self.standings]
                write_json(self._folder / FILE, {"runs": entries + others})
        except OSError as error:
            if error.errno not in NO_ROOM:
                raise

    def _print(self, words: str) -> None:
        self._erase()
        print(words, file=sys.stderr, flush=True)

    def _draw(self) -> None:
        if self._is_live:
            self._erase()
            width, height = _terminal()
            # One line is the cursor's. A longer line would take two, of which one would stay
            lines = [line[: width - 1] for line in self.table(max(height - 1, 1))]
            self._drawn = len(lines)
            print("\n".join(lines), file=sys.stderr, flush=True)

    def _erase(self) -> None:
        """Erase the table, so that the next output takes its place."""
        if self._drawn:
            print(f"\x1b[{self._drawn}F\x1b[J", end="", file=sys.stderr)
        self._drawn = 0


def _terminal() -> tuple[int, int]:
    """Columns and lines of the terminal on which the table is drawn; some do not say."""
    try:
        width, height = os.get_terminal_size(sys.stderr.fileno())
    except (OSError, ValueError):
        width, height = 0, 0
    return width or 80, height or 24
