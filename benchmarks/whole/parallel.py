"""Runs side by side, each on cores of its own."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from threading import Condition, Event

from whole.run import WholeRun


def usable_cores() -> list[int]:
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


class Cores:
    """Those that no run is on."""

    def __init__(self, ids: Sequence[int]):
        self._free, self._changed = sorted(ids), Condition()

    @contextmanager
    def taken(self, count: int) -> Iterator[list[int]]:
        """So many of them, as soon as there are."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._free) >= count)
            mine, self._free = self._free[:count], self._free[count:]
        try:
            yield mine
        finally:
            with self._changed:
                self._free = sorted([*self._free, *mine])
                self._changed.notify_all()


def carry_out_all(
    runs: Sequence[WholeRun],
    jobs: int,
    ids: Sequence[int],
    carry_out: Callable[[WholeRun, list[int], Event], None],
) -> None:
    """Each once, in their order, at most `jobs` at a time on the cores `ids`.

    `carry_out` gets its cores, and an event that is set when it has to end, as on Ctrl-C.
    """
    cores, stop = Cores(ids), Event()

    def on_cores(run: WholeRun) -> None:
        with cores.taken(run.cores) as mine:
            if not stop.is_set():
                carry_out(run, mine, stop)

    with ThreadPoolExecutor(jobs) as pool:
        futures = [pool.submit(on_cores, run) for run in runs]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
