"""`simtune tune`: the parameters alone, without a policy."""

import logging
import math
import time
from typing import Any

from simtune.budget import Budget
from simtune.checking.expected_precision import expected_precision
from simtune.config import ROBOTS, TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import Experiment, build_experiment
from simtune.experiment.run import Run
from simtune.experiment.settings import Settings
from simtune.progress import ReportProgress, silent
from simtune.run.config import TIME_IS_OVER
from simtune.run.kept import kept_state
from simtune.tasks import AnyTask
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.search import Callbacks, Search, TimeNeeded

log = logging.getLogger(__name__)
# Time for videos and the report: as long as the longer half of the start took, to load libraries or
# to film, within these bounds. A machine that is slow at first is so at the end.
_AT_THE_END_S = (6.0, 30.0)
_SURELY = 0.6  # of the measured time, since the machine may have been busy at that moment
_SHORTENED = "; in --budget-minutes {:g} it is a shortened one, whose intervals may be wider"
# Relative to a whole round: with less time no known world may be fitted, which verdicts need.
_HARDLY_ENOUGH = 0.5
_UNJUDGED = "; in --budget-minutes {:g} perhaps nothing can be called identified: {:g} are enough"
# Of six-minute runs on a busy machine, which had .20 to .24 of a whole round, three of four ended
# without a fit.
_HARDLY_A_FIT = 0.3
_UNFITTED = (
    "In --budget-minutes %g there is hardly time to fit anything: what pictures tell will be first "
    "guesses by networks, whose intervals nothing tests. A fit needs --budget-minutes %d; it is "
    "cheaper with fewer or shorter episodes, or %s"
)
_CHECK_SHARE = 0.06  # of the budget, in which check may say what to expect
_WORTHWHILE = 0.6  # of the last round's time: the next one knows where to search


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
    began_s = time.monotonic()
    experiment = build_experiment(config, report, settings, task)
    built_s = time.monotonic() - began_s  # for example to film the real world
    ending_s = min(max(_AT_THE_END_S[0], loading_s, built_s), _AT_THE_END_S[1])
    if config.real in ROBOTS:  # takes its own time to film, which is no part of the budget
        began_s = time.monotonic()
    started_s = began_s - loading_s
    warnings = experiment.warnings(experiment.recordings)
    _warn(warnings)
    search, real = experiment.search, experiment.recordings
    needed = search.measure_time(real)
    if settings is None and kept_state(config.out) is None:  # nothing is written before
        other_s = time.monotonic() - started_s + ending_s
        _refuse_if_too_short(config.budget_minutes, other_s, needed)
        _say_if_unfitted(search, config.budget_minutes, other_s, needed)
    may_check = needed.check_s < _CHECK_SHARE * 60 * config.budget_minutes
    expected, doubts = _expected_precision(experiment) if may_check else ({}, [])
    _warn(doubts)
    warnings += doubts
    before_run_s = time.monotonic() - started_s
    with Run(experiment, report) as run:
        run.resume()
        run.folder.write_config()
        if run.num_rounds and search.stop_reason:
            report("the search is over already; another --out searches anew", 1.0)
        spent_s = before_run_s + run.wall_s + ending_s
        budget = Budget(60 * config.budget_minutes - spent_s, report)
        while not run.num_rounds or not (search.stop_reason or _is_over(budget, run)):
            _run_round(run, budget)
        stopped = {"stopped": search.stop_reason or TIME_IS_OVER}
        return run.finish(real, stopped | expected, warnings, command)


def _run_round(run: Run, budget: Budget) -> None:
    """Run one round of the search; log and save it."""
    experiment, began_s = run.experiment, time.monotonic()
    real, callbacks = experiment.recordings, Callbacks(run.log_early, run.save_within)
    found = experiment.search.run_round(real, budget, callbacks)
    run.round_s = time.monotonic() - began_s
    run.step = experiment.simulator.num_steps
    run.log_round(found, len(real))
    run.save()


def _warn(warnings: list[str]) -> None:
    """At once, not after minutes."""
    for warning in warnings:
        log.warning("%s", warning)


def _expected_precision(experiment: Experiment) -> tuple[dict[str, Any], list[str]]:
    """What `simtune check` would say of these episodes, for result.json, and its warnings."""
    if experiment.search_name != "posterior":  # others give no intervals
        return {}, []
    simulator, seen = experiment.simulator, experiment.context.observation
    names = experiment.real.facts.get("names", ())
    real, seed = experiment.recordings, experiment.config.seed
    found = expected_precision(simulator, seen, real, seed, names)
    return {"check": found.parameters}, found.warnings


def _refuse_if_too_short(minutes: float, other_s: float, needed: TimeNeeded) -> None:
    """Raises InputError for a time too short for a sound answer.

    `other_s`: time for all but rounds.
    """
    least_s, whole_s = needed.least_s, needed.whole_s
    if not whole_s:  # a search that cannot tell
        if 60 * minutes < other_s:
            raise InputError(
                f"--budget-minutes {minutes:g} is too short: nothing can be searched in that time, "
                f"as the run takes about {other_s:.0f} s beside the search; give more"
            )
        return
    if 60 * minutes < _SURELY * least_s + other_s:
        enough = math.ceil((2 * least_s + other_s) / 6) / 10
        whole_minutes = max(math.ceil((whole_s + other_s) / 60), math.ceil(enough))
        raise InputError(
            f"--budget-minutes {minutes:g} is too short: the smallest round takes "
            f"{least_s:.0f} to {2 * least_s:.0f} s on this machine, a whole one {whole_s:.0f} s; "
            f"verdicts need --budget-minutes {whole_minutes}, an answer --budget-minutes "
            f"{enough:g} or more" + (f". {needed.mostly}" if needed.mostly else "")
        )
    first_s = _first_s(minutes, needed)
    other_s += first_s
    enough_s, said = whole_s + other_s, f", after {first_s:.0f} s for readings" * bool(first_s)
    if 60 * minutes < _HARDLY_ENOUGH * whole_s + other_s:
        said += _UNJUDGED.format(minutes, math.ceil(enough_s / 60))
    elif 60 * minutes < enough_s:
        said += _SHORTENED.format(minutes)
    log.info("a round takes about %.0f s here%s", whole_s, said)


def _first_s(minutes: float, needed: TimeNeeded) -> float:
    """Seconds before the first round: readings are left half of all time at most."""
    return min(needed.first_s, 60 * minutes / 2)


def _say_if_unfitted(search: Search, minutes: float, other_s: float, needed: TimeNeeded) -> None:
    """If networks alone will probably have the say, though a fit is possible."""
    other_s += _first_s(minutes, needed)
    left_s, whole_s = 60 * minutes - other_s, needed.whole_s
    if not isinstance(search, PosteriorSearch) or not search.context.can_fit:
        return
    if left_s < _HARDLY_A_FIT * whole_s:
        enough = math.ceil((_HARDLY_ENOUGH * whole_s + other_s) / 60)
        has_readings = bool(search.context.observation.sensors)
        # At a lower rate actions are averaged: servos' dampings came out 7 to 13 % too low
        alone = "from the joint readings alone (--observe joints)"
        log.info(_UNFITTED, minutes, enough, alone if has_readings else "a lower --control-hz")


def _is_over(budget: Budget, run: Run) -> bool:
    """Whether too little time is left for a round to learn more than the last one."""
    return budget.is_over or budget.seconds_left < _WORTHWHILE * run.round_s
