"""Workers of this machine: threads that each carry out one run after another."""

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed

from simtune.errors import InputError
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import Attempts
from simtune.sweep.lease import usable_cores
from simtune.sweep.standing import Standing


def num_workers(asked: int | None, cores_per_run: int) -> int:
    """Raises InputError where this machine's cores do not suffice."""
    cores = len(usable_cores())
    most = cores // cores_per_run if cores else None  # unknown where none can be bound
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
    """How each stands in the end, as they end. Whatever ends the caller ends all of them."""

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
