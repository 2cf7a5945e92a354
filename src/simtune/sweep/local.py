"""Carries out runs on this machine, with threads that each do one run after another."""

from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager

from simtune.errors import InputError
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import Attempts
from simtune.sweep.lease import usable_cores
from simtune.sweep.process import Processes
from simtune.sweep.standing import Standing


def num_workers(asked: int | None, cores_per_run: int) -> int:
    """Number of simultaneous runs. Raises InputError if this machine has too few cores."""
    cores = len(usable_cores())
    most = cores // cores_per_run if cores else None  # None: processes cannot be bound to cores
    if most == 0 or (asked and most and asked > most):
        raise InputError(
            f"{asked or 1} runs at a time on {cores_per_run} cores each need more than the {cores} "
            "there are: give fewer --workers or --cores-per-run"
        )
    return asked or most or 1


def carry_out_here(
    runs: Iterable[AskedRun],
    attempts: Attempts,
    workers: int,
    on_begin: Callable[[AskedRun], None],
) -> Generator[tuple[AskedRun, Standing]]:
    """Yield each run and its final standing, in the order in which they end.

    What another process has goes to the end of the queue, so that several drivers share the work.
    An exception, or closing the generator, stops all runs.
    """

    def work(run: AskedRun) -> Standing:
        on_begin(run)
        return attempts.carry_out(run)

    with at_work(workers, attempts.processes) as pool:
        queue = {pool.submit(work, run): run for run in runs}
        while queue:
            for future in wait(queue, return_when=FIRST_COMPLETED).done:
                run, standing = queue.pop(future), future.result()
                if standing.status == "waiting":
                    queue[pool.submit(work, run)] = run
                else:
                    yield run, standing


@contextmanager
def at_work(workers: int, processes: Processes) -> Iterator[ThreadPoolExecutor]:
    """Threads that wait for `processes`; an exception stops them, and what they wait for."""
    with ThreadPoolExecutor(workers) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            processes.stop()
            raise
