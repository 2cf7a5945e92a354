"""`simtune sweep`: carries out a grid of runs, from any intermediate state to the end.

The state of a sweep is in its folder only. Each run is an ordinary run folder, which the same
command resumes. Beside it are a lease, held by the process that carries it out, and notes of its
failures. So drivers may be killed, or several may work side by side.

runs/NAME/              a run's folder
state/runs/NAME.lock    its lease
state/runs/NAME.json    its failures and time
state/runs/NAME.txt     its output
state/board.lock        held while sweep.json is written
pilots/ state/pilots/   the same for a dry run's pilots
pilots.json             estimated times of runs, from pilots
sweep.json              the state of all runs, also of other grids in this folder
"""

from collections.abc import Sequence
from contextlib import closing
from typing import Any

from simtune.config import SweepConfig
from simtune.errors import InputError
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import Attempts
from simtune.sweep.board import Board, read_entries
from simtune.sweep.contents import check_contents
from simtune.sweep.grid import read_grid
from simtune.sweep.lease import Lease
from simtune.sweep.local import carry_out_here, num_workers
from simtune.sweep.on_ray import carry_out_on_ray, connect
from simtune.sweep.process import Processes
from simtune.sweep.standing import Places, Standing


def sweep(config: SweepConfig, program: Sequence[str] | None = None) -> dict[str, Standing]:
    """Carry out a grid; returns {name: final standing}.

    `program`: the command that gets the arguments of `tune` and `train`, see `Processes`. Raises
    InputError for invalid input, before any run starts.
    """
    runs = open_sweep(config)
    settings: dict[str, Any] = {
        "folder": config.out.resolve(),
        "retries": config.retries,
        "cores_per_run": config.cores_per_run,
    }
    ray, workers = places_to_run(config)
    status = Board(config.out, runs, config.retries, workers)
    waiting = [run for run in runs if status.standings[run.name].status == "waiting"]
    if ray:
        ended = carry_out_on_ray(ray, waiting, program, settings)
    else:
        attempts = Attempts(**settings, processes=Processes(program), say=status.say)
        ended = carry_out_here(waiting, attempts, workers, status.begin)
    with closing(ended):  # ends the runs as well, whatever happens here
        for run, standing in ended:
            status.end(run, standing)
    return status.standings


def open_sweep(config: SweepConfig) -> list[AskedRun]:
    """The grid's runs; makes the sweep's folder.

    Raises InputError for an invalid grid, or if a name meant another run before, which has begun,
    also if its task's files, its recordings or its truth have been changed since.
    """
    config.check()
    runs = read_grid(config.grid)
    try:
        config.out.mkdir(parents=True, exist_ok=True)
        before = {entry["name"]: entry["asked"] for entry in read_entries(config.out)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{config.out} cannot be a sweep's folder: {error!r}") from error
    redefined = [run for run in runs if before.get(run.name, run.asked) != run.asked]
    for run in redefined:
        if _has_begun(Places(config.out, run.name)):
            differing = {k for k, _ in before[run.name].items() ^ run.asked.items()}
            raise InputError(
                f"{config.out} has a run {run.name} of another {', '.join(sorted(differing))}: "
                "give its block of the grid a name, or another --out"
            )
    check_contents(runs, config.out)
    for run in redefined:
        Places(config.out, run.name).forget()
    return runs


def _has_begun(places: Places) -> bool:
    """Whether a run has a folder, or a process has it. One refused at its start has none."""
    if places.run.exists():
        return True
    places.make_folders()
    if lease := Lease.take(places.lease):
        lease.close()
    return lease is None


def places_to_run(config: SweepConfig) -> tuple[Any, int]:
    """The module Ray if requested, else None; number of simultaneous runs. Raises InputError."""
    if config.ray is None:
        return None, num_workers(config.workers, config.cores_per_run)
    ray = connect(config.ray)
    cores = int(ray.cluster_resources().get("CPU", 0))
    return ray, max(1, cores // config.cores_per_run)
