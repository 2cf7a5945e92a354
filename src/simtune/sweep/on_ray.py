"""A Ray cluster: it decides where runs go, and repeats what dies with a worker or a node."""

import importlib
from collections.abc import Generator, Sequence
from typing import Any

from simtune.errors import InputError
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import Attempts
from simtune.sweep.process import Processes
from simtune.sweep.standing import Standing


def connect(address: str) -> Any:
    """The module `ray`, connected. Raises InputError where there is none, or no cluster."""
    try:
        ray = importlib.import_module("ray")  # an extra
    except ImportError:
        raise InputError("--ray needs Ray: pip install 'simtune[ray]'") from None
    try:
        ray.init(address=address, log_to_driver=False)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise InputError(f"--ray {address}: no cluster can be reached: {error}") from error
    return ray


def carry_out_on_ray(
    ray: Any, runs: Sequence[AskedRun], program: Sequence[str], settings: dict[str, Any]
) -> Generator[tuple[AskedRun, Standing]]:
    """How each stands in the end, as they end. `settings`: of `Attempts`, but for its processes.

    A run's failures are counted in the sweep's folder; what dies with its worker or its node Ray
    repeats elsewhere, endlessly. The tasks end with this process.
    """
    options = {"num_cpus": settings["cores_per_run"], "max_retries": -1}
    task = ray.remote(**options)(_carry_out)
    waiting = {task.remote(run, tuple(program), settings): run for run in runs}
    try:
        while waiting:
            (ended,), _ = ray.wait(list(waiting), num_returns=1)
            yield waiting.pop(ended), ray.get(ended)
    finally:
        ray.shutdown()


def _carry_out(run: AskedRun, program: Sequence[str], settings: dict[str, Any]) -> Standing:
    """On whichever machine Ray chose."""
    return Attempts(**settings, processes=Processes(program)).carry_out(run)
