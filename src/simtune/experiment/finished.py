"""Whether a run of `tune` is finished: then the same command has nothing to do there.

Nothing here loads torch, which takes seconds.
"""

import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from simtune.config import NO_RECORDINGS, TrainConfig, TuneConfig
from simtune.experiment.outcome import asked
from simtune.parameters.values_file import read_parameters
from simtune.real.observed import observed, open_recordings
from simtune.real.truth import Truth
from simtune.run.config import TIME_IS_OVER, check_asked, stored_config
from simtune.run.kept import kept_state
from simtune.run.stored import read_result
from simtune.run.versions import changed_versions
from simtune.tasks import AnyTask, load_any_task

AT_LEAST_AT_THE_END_S = 6.0  # of the budget, for videos and the report
WORTHWHILE = 0.6  # of the last round's time: the next one knows where to search

log = logging.getLogger(__name__)
_HashOf = Callable[[TuneConfig | TrainConfig, AnyTask], str]


def finished_result(config: TuneConfig, task: AnyTask | None = None) -> dict[str, Any] | None:
    """The result.json of a finished run in `config.out`, and says so; None: there is work to do.

    There is some where time is left for another round, a session has not ended, the report is
    missing, or another version made it. `task`: the one `config.task` names, if it is loaded.
    Raises InputError if the run is of another command, task or real world.
    """
    stored = stored_config(config.out)
    if stored is None or changed_versions(stored) or not (config.out / "report.html").is_file():
        return None
    result, state = _result(config.out), kept_state(config.out)
    if result is None or state is None or not _is_over(config, result, state):
        return None
    task = task or load_any_task(config.task)
    check_asked(config.out, asked(config, task))
    say_finished(config.out, result["stopped"])
    check_asked(config.out, real_content(config, task, stored["config"]))
    return result


def say_finished(out: Path, stopped: str) -> None:
    """Log why nothing is searched, and what would go on."""
    more = "another --out searches anew"
    if stopped == TIME_IS_OVER:
        more = "with more --budget-minutes it goes on"
    log.info("%s is finished: %s; %s", out, stopped, more)


def real_content(
    config: TuneConfig | TrainConfig,
    task: AnyTask,
    stored: Mapping[str, Any],
    hash_of: _HashOf | None = None,
) -> dict[str, Any]:
    """The part of `outcome.run_config` that `asked` leaves out, if a run's `stored` one has it.

    A training that needs no recordings has not read them. `hash_of` recordings: `recordings_hash`.
    """
    if config.real == "pseudo" and stored.get("truth"):
        parameters = read_parameters(config.real_parameters, task.parameters)
        file = config.real_parameters and str(config.real_parameters)
        return {"truth": Truth(task.parameters, parameters).digest, "real_parameters": file}
    if config.real not in NO_RECORDINGS and stored.get("recordings"):
        found = (hash_of or recordings_hash)(config, task)
        return {"recordings": {"dataset_hash": found}, "real": config.real}
    return {}


def recordings_hash(config: TuneConfig | TrainConfig, task: AnyTask) -> str:
    """As a run stores it. Raises InputError for what the run would refuse."""
    seen = observed(task, config.observed, is_simulated=False)
    return open_recordings(config.real, task, config, None, seen).content_hash


def _result(out: Path) -> dict[str, Any] | None:
    """A result.json that has what a finished run's has."""
    result = read_result(out)
    if result is None or not {"method", "search"} <= result.keys():
        return None
    is_whole = isinstance(result.get("stopped"), str) and isinstance(result.get("warnings"), list)
    return result if is_whole else None


def _is_over(config: TuneConfig, result: Mapping[str, Any], state: Mapping[str, Any]) -> bool:
    """Whether the result is of the newest round, and no time is left for another one."""
    told = [its.get("mean") for its in result["parameters"].values()]
    if told != state["estimate"]["mean"]:  # a later session was interrupted
        return False
    left_s = 60 * config.budget_minutes - AT_LEAST_AT_THE_END_S - state["wall_s"]
    is_short = left_s < WORTHWHILE * state.get("round_s", math.inf)
    return result["stopped"] != TIME_IS_OVER or left_s <= 0 or is_short
