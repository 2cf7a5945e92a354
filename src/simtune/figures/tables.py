"""Final results over all seeds, as rows of tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simtune.config import UNTUNED
from simtune.figures.authors import AUTHORS
from simtune.figures.groups import ORDER, Group, Setting
from simtune.figures.records import FinishedRun
from simtune.figures.statistics import Centre, centre, interquartile_mean, stratified


@dataclass(frozen=True, kw_only=True)
class Row:
    """A method in a setting; unknown values are None."""

    setting: str
    method: str
    seeds: int
    score: Centre | None  # return, or success as a share
    near_success: Centre | None
    returned: Centre | None  # only if the score is success
    of_oracle: Centre | None  # the score as a share of the oracles' centre
    percent_error: Centre | None
    real_episodes: Centre | None
    policy_steps: Centre | None
    minutes: Centre | None


def rows(setting: Setting) -> list[Row]:
    return [_row(setting, group) for group in setting.groups]


def _row(setting: Setting, group: Group) -> Row:
    tells_error = group.method not in UNTUNED
    return Row(
        setting=setting.title,
        method=group.method,
        seeds=group.num_seeds,
        score=_known(group.scores(setting.score)) if setting.is_training else None,
        near_success=_known(group.scores("near_success")),
        of_oracle=_known(shares_of_oracle(setting, group)),
        returned=_known(group.scores("return")) if setting.score == "success" else None,
        percent_error=_known(group.scores("percent_error")) if tells_error else None,
        real_episodes=_known(group.scores("real_episodes")),
        policy_steps=_known(group.scores("policy_steps")),
        minutes=_known([wall_s / 60 for wall_s in group.scores("wall_s")]),
    )


def _known(values: Sequence[float]) -> Centre | None:
    return centre(values) if values else None


def shares_of_oracle(setting: Setting, group: Group) -> list[float]:
    """Each seed's score as a share of the oracles' in this setting, their interquartile mean."""
    oracle = setting.group("oracle")
    reached = oracle.scores(setting.score) if oracle else []
    level = float(interquartile_mean(np.array(reached))) if reached else 0.0
    return [score / level for score in group.scores(setting.score)] if level > 0 else []


class Overall(NamedTuple):
    """A method over several tasks."""

    of_oracle: Centre  # the score as a share of the oracle's, over tasks and seeds
    num_tasks: int  # which have runs of the method, and of an oracle that earns something


def overall(settings: Sequence[Setting]) -> dict[str, Overall]:
    """{method: its share of the oracle's score}; methods may lack tasks."""
    found = {}
    for method in ORDER:
        pairs = [(s, group) for s in settings if (group := s.group(method))]
        if strata := [shares for s, group in pairs if (shares := shares_of_oracle(s, group))]:
            found[method] = Overall(stratified(strata), len(strata))
    return found


def authors(setting: Setting) -> list[dict[str, Any]]:
    """Results of the paper's authors in the same task, one dict per method."""
    reached = AUTHORS.get(setting.task)
    if not setting.is_training or setting.has_gap or reached is None:
        return []
    oracle = reached.methods["oracle"].mean
    return [
        {
            "method": method,
            "score": reached.methods[method],
            "of_oracle": reached.methods[method].mean / oracle,
            "policy_steps": reached.policy_steps,
            "percent_error": reached.percent_error[1]
            if reached.percent_error and method == "autotune"
            else None,
        }
        for method in ORDER
        if method in reached.methods
    ]


def flat(row: Row) -> dict[str, Any]:
    """A row of the CSV: each figure with its interval."""
    cells: dict[str, Any] = {}
    for name, value in vars(row).items():
        if isinstance(value, Centre):
            cells |= {name: value.mean, f"{name}_low": value.low, f"{name}_high": value.high}
        else:
            cells[name] = value
    return cells


def run_row(record: FinishedRun) -> dict[str, Any]:
    """A single run as a row of the CSV, for checking the figures or drawing others."""
    names = ("return", "success", "near_success", "percent_error", "real_episodes")
    names += ("policy_steps", "sim_steps", "wall_s")
    known = {"run": record.name, "task": record.task, "method": record.method}
    known |= {"seed": record.config.get("seed"), "real_gap": bool(record.config.get("real_gap"))}
    return known | {name: record.score(name) for name in names}
