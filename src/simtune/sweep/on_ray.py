"""Carries out runs on a Ray cluster, which places them, and repeats them if a node dies."""

import importlib
import socket
from collections.abc import Generator, Sequence
from typing import Any

from simtune.errors import InputError
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import Attempts
from simtune.sweep.process import Processes
from simtune.sweep.standing import Standing

_REACHED_WITHIN_S = 10.0  # Ray itself goes on trying for minutes


def connect(address: str) -> Any:
    """The module `ray`, connected. Raises InputError if it is missing, or there is no cluster."""
    try:
        ray = importlib.import_module("ray")  # an optional dependency
    except ImportError:
        raise InputError("--ray needs Ray: pip install ray") from None
    try:
        host, _, port = address.removeprefix("ray://").rpartition(":")
        if port.isdigit():
            socket.create_connection((host, int(port)), _REACHED_WITHIN_S).close()
        ray.init(address=address, log_to_driver=False)
    except (OSError, OverflowError, RuntimeError, ValueError) as error:
        raise InputError(f"--ray {address}: no cluster can be reached: {error}") from error
    return ray


def carry_out_on_ray(
    ray: Any, runs: Sequence[AskedRun], program: Sequence[str] | None, settings: dict[str, Any]
) -> Generator[tuple[AskedRun, Standing]]:
    """Yield each run and its final standing, in the order in which they end.

    `settings`: arguments of `Attempts` without `processes`. Failures of a run are counted in the
    sweep's folder. If a worker or node dies, Ray repeats the run elsewhere, any number of times.
    The tasks end with this process.
    """
    options = {"num_cpus": settings["cores_per_run"], "max_retries": -1}
    task = ray.remote(**options)(_carry_out)

    def submit(run: AskedRun) -> Any:
        return task.remote(run, program, settings)

    queue = {submit(run): run for run in runs}
    try:
        while queue:
            (ended,), _ = ray.wait(list(queue), num_returns=1)
            run, standing = queue.pop(ended), ray.get(ended)
            if standing.status == "waiting":  # another process has it
                queue[submit(run)] = run
            else:
                yield run, standing
    finally:
        ray.shutdown()


def _carry_out(run: AskedRun, program: Sequence[str] | None, settings: dict[str, Any]) -> Standing:
    """Carry out a run, on the machine that Ray has chosen."""
    return Attempts(**settings, processes=Processes(program)).carry_out(run)
