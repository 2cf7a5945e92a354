"""`simtune sweep --dry-run`: lists the runs to do, and estimates their time by pilots."""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed

from simtune.config import SweepConfig
from simtune.report.words import duration
from simtune.sweep.asked import AskedRun
from simtune.sweep.estimate import Expectation, seconds_left
from simtune.sweep.local import at_work, num_workers
from simtune.sweep.pilot import Pilot, Pilots, measure
from simtune.sweep.process import Processes
from simtune.sweep.standing import Places
from simtune.sweep.sweep import open_sweep, places_to_run


def dry_run(
    config: SweepConfig, say: Callable[[str], None], program: Sequence[str] | None = None
) -> float | None:
    """Estimated seconds that the sweep still takes; None if a pilot gave no estimate.

    The sweep's runs are not touched. Pilots are measured once, and again if they may take longer
    now; estimates from finished runs take precedence. Raises InputError for invalid input.
    """
    runs, folder = open_sweep(config), config.out.resolve()
    _, at_once = places_to_run(config)
    standings = {run.name: Places(folder, run.name).standing(config.retries) for run in runs}
    waiting = [run for run in runs if standings[run.name].status == "waiting"]
    finished = {run.kind for run in runs if standings[run.name].status == "done"}
    pilots = Pilots(folder)
    unknown = pilots.missing(waiting, 60 * config.pilot_minutes)
    _measure([run for run in unknown if run.kind not in finished], pilots, config, program, say)
    expected = Expectation(runs, standings, pilots)
    for kind in dict.fromkeys(run.kind for run in waiting):
        alike = [run for run in waiting if run.kind == kind]
        pilot = pilots.get(kind)
        by = "finished ones" if kind in finished or not pilot else pilot.how
        say(f"{len(alike):4d} × {duration(expected[alike[0]])} (by {by}): {kind}")
    left_s = seconds_left([expected[run] for run in waiting], at_once)
    how = f"{at_once} at a time" if at_once > 1 else "one after another"
    say(f"{len(waiting)} of {len(runs)} runs are to be done, {how}: {duration(left_s)}")
    return left_s


def _measure(
    runs: Sequence[AskedRun],
    pilots: Pilots,
    config: SweepConfig,
    program: Sequence[str] | None,
    say: Callable[[str], None],
) -> None:
    """Add a pilot of each run, measured on this machine's workers, as soon as it has ended."""
    if not runs:
        return
    limit_s, processes = 60 * config.pilot_minutes, Processes(program)
    workers = num_workers(config.workers, config.cores_per_run)
    longest = duration(-(-len(runs) // workers) * limit_s)
    each = f"{workers} at a time, each {duration(limit_s)} at most"
    say(f"pilots of {len(runs)} kinds, {each}: {longest} at most, and the next time they are known")

    def pilot(run: AskedRun) -> Pilot:
        return measure(run, config.out.resolve(), processes, config.cores_per_run, limit_s, say)

    with at_work(workers, processes) as pool:
        measured = {pool.submit(pilot, run): run for run in runs}
        for ended in as_completed(measured):
            pilots.add(measured[ended].kind, ended.result())
