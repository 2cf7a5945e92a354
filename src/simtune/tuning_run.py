"""`simtune tune`: the parameters alone, without a policy."""

import time
from typing import Any

from simtune.budget import Budget
from simtune.config import ROBOTS, TuneConfig
from simtune.experiment.enough_time import refuse_if_too_short, say_if_unfitted
from simtune.experiment.experiment import build_experiment
from simtune.experiment.finished import AT_LEAST_AT_THE_END_S, WORTHWHILE, say_finished
from simtune.experiment.recording_checks import RecordingChecks
from simtune.experiment.run import Run
from simtune.experiment.settings import Settings
from simtune.progress import ReportProgress, silent, told
from simtune.run.config import TIME_IS_OVER
from simtune.run.kept import kept_state
from simtune.tasks import AnyTask
from simtune.tuning.search import Callbacks

# Time for videos and the report: as long as the longer half of the start took, to load libraries or
# to film, within these bounds. A machine that is slow at first is so at the end.
_AT_THE_END_S = (AT_LEAST_AT_THE_END_S, 30.0)


def tune(
    config: TuneConfig,
    report: ReportProgress = silent,
    settings: Settings | None = None,
    *,
    command: str | None = None,
    task: AnyTask | None = None,
    loading_s: float = 0.0,
) -> dict[str, Any]:
    """Find the parameters of a real world; returns the content of result.json.

    An interrupted run resumes after its last round. `command`: what the user typed, to be stored.
    `task`: the one `config.task` names, if it is loaded already, or no file. `loading_s`: seconds
    of the budget that are spent already. Raises InputError for invalid input, with nothing written,
    and RuntimeError for what fails on the way.
    """
    clock = _Clock(loading_s)
    experiment = build_experiment(config, report, settings, task)
    clock.is_built(by_a_robot=config.real in ROBOTS)
    search, real, minutes = experiment.search, experiment.recordings, config.budget_minutes
    warnings = told(experiment.warnings(real))
    needed = search.measure_time(real)
    kept = kept_state(config.out)
    if settings is None and kept is None:  # nothing is written before
        refuse_if_too_short(minutes, clock.spent_s, needed)
        say_if_unfitted(search, minutes, clock.spent_s, needed)
    checks = RecordingChecks.kept(kept).completed(experiment, minutes, needed)
    warnings += told(checks.warnings)
    with Run(experiment, report, clock.began_s) as run:
        run.resume()
        run.to_keep = checks.to_keep()
        run.folder.write_config()
        budget = Budget(60 * minutes - clock.ending_s - run.wall_s, report)
        if run.num_rounds and (search.stop_reason or _is_over(budget, run)):
            say_finished(config.out, search.stop_reason or TIME_IS_OVER)
        while not run.num_rounds or not (search.stop_reason or _is_over(budget, run)):
            _run_round(run, budget)
        stopped = {"stopped": search.stop_reason or TIME_IS_OVER}
        return run.finish(real, stopped | checks.in_result, warnings, command)


class _Clock:
    """Time that is spent before a run's folder is opened, and what its end will take."""

    def __init__(self, loading_s: float):
        self._loading_s = loading_s
        self.began_s = time.monotonic() - loading_s  # of the session, without a robot's time
        self.ending_s = _AT_THE_END_S[0]

    def is_built(self, by_a_robot: bool) -> None:
        """The real world is filmed; the time that a robot takes for it does not count."""
        now_s = time.monotonic()
        building_s = now_s - self.began_s - self._loading_s
        longest_s = max(self.ending_s, self._loading_s, building_s)
        self.ending_s = min(longest_s, _AT_THE_END_S[1])
        if by_a_robot:
            self.began_s += building_s

    @property
    def spent_s(self) -> float:
        """Seconds until now, and those kept for the end."""
        return time.monotonic() - self.began_s + self.ending_s


def _run_round(run: Run, budget: Budget) -> None:
    """Run one round of the search; log and save it."""
    experiment, began_s = run.experiment, time.monotonic()
    real, callbacks = experiment.recordings, Callbacks(run.log_early, run.save_within)
    found = experiment.search.run_round(real, budget, callbacks)
    run.round_s = time.monotonic() - began_s
    run.step = experiment.simulator.num_steps
    run.log_round(found, len(real))
    run.save()


def _is_over(budget: Budget, run: Run) -> bool:
    """Whether too little time is left for a round to learn more than the last one."""
    return budget.is_over or budget.seconds_left < WORTHWHILE * run.round_s
