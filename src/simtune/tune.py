"""`simtune tune`: the parameters alone, without a policy."""

import logging
from typing import Any

from simtune.budget import Budget
from simtune.config import TuneConfig
from simtune.experiment.experiment import build_experiment
from simtune.experiment.run import Run
from simtune.experiment.settings import Settings
from simtune.progress import ReportProgress, silent

log = logging.getLogger(__name__)


def tune(
    config: TuneConfig,
    report: ReportProgress = silent,
    settings: Settings | None = None,
    *,
    command: str | None = None,
) -> dict[str, Any]:
    """Find the parameters of a real world; returns the content of result.json.

    A run that was interrupted goes on where its last round ended. `command`: what the user typed,
    to be stored.
    Raises InputError for what cannot be used, with nothing written, and RuntimeError for what
    fails on the way.
    """
    experiment = build_experiment(config, report, settings)
    warnings = experiment.warnings(experiment.recordings)
    for warning in warnings:  # now, not after minutes
        log.warning("%s", warning)
    with Run(experiment, report) as run:
        run.resume()
        if run.num_rounds and experiment.search.finished:
            report("the search is over already; another --out searches anew", 1.0)
        budget = Budget(60 * config.budget_minutes - run.wall_s, report)
        while not run.num_rounds or not (experiment.search.finished or budget.is_over):
            run.folder.drop_result()  # of an earlier sitting: this one goes on
            found = experiment.search.run_round(experiment.recordings, budget)
            run.step = experiment.simulator.num_steps
            run.log_round(found, len(experiment.recordings))
            run.save()
        return run.finish(experiment.recordings, {}, warnings, command)
