"""Carries out runs on this machine, with threads that each do one run after another."""

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed

from simtune.errors import InputError
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import Attempts
from simtune.sweep.lease import usable_cores
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

    An exception, or closing the generator, stops all runs.
    """

    def work(run: AskedRun) -> Standing:
        on_begin(run)
        return attempts.carry_out(run)

    with ThreadPoolExecutor(workers) as pool:
        futures = {pool.submit(work, run): run for run in runs}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            attempts.processes.stop()
            raise
