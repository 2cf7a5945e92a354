"""Groups runs for comparison: settings, methods, and ablations of other options.

A setting is a task, trained or only tuned, with a reality gap or not, after pretraining
(sim-to-real) or not. Within a setting, runs of a method that differ only by their seeds are a
group. If an option was varied, its most common value, among runs of methods that use it, is the
usual one: groups with usual options are drawn together, method beside method; groups with one other
value are an ablation of its option.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from simtune.figures.records import FinishedRun
from simtune.validate import is_number

ORDER = ("autotune", "regression", "dr", "untuned", "oracle")  # of methods; others come after


@dataclass(frozen=True)
class Group:
    """Runs that differ only by their seeds."""

    method: str
    runs: list[FinishedRun]

    @property
    def num_seeds(self) -> int:
        return len({run.config.get("seed") for run in self.runs})

    def scores(self, name: str) -> list[float]:
        return [value for run in self.runs if (value := run.score(name)) is not None]


@dataclass(frozen=True)
class Ablation:
    """One option varied, with usual values of all others."""

    option: str
    groups: list[tuple[Any, Group]]  # (the option's value, group)


@dataclass(frozen=True)
class Setting:
    task: str
    is_training: bool
    has_gap: bool
    is_pretrained: bool
    groups: list[Group]  # one per method, with usual options
    ablations: list[Ablation]
    num_others: int  # runs with more than one unusual option, which are not drawn
    number: int = 1  # above 1: of settings whose names are alike as names of files

    @property
    def title(self) -> str:
        what = "" if self.is_training else ", parameters alone"
        what += ", sim-to-real" if self.is_pretrained else ""
        return self.task + what + (", through the gap" if self.has_gap else "")

    @property
    def key(self) -> str:
        """The setting's part of file names."""
        parts = [self.task, "" if self.is_training else "tune"]
        parts += ["sim-to-real" if self.is_pretrained else "", "gap" if self.has_gap else ""]
        parts += [str(self.number) if self.number > 1 else ""]
        return re.sub(r"[^\w.=+-]", "_", "-".join(part for part in parts if part))

    @property
    def score(self) -> str:
        """The score of policies: success if the task has a goal, else return."""
        has_goal = any("success" in run.result for group in self.groups for run in group.runs)
        return "success" if has_goal else "return"

    @property
    def notes(self) -> list[str]:
        """What makes its runs no plain seeds of the same."""
        runs = [run for group in self.groups for run in group.runs]
        contents = {run.config.get("task_content") for run in runs}
        found = [
            f"{group.method}: {len(group.runs)} runs of {group.num_seeds} seeds, so some count "
            "more than once."
            for group in self.groups
            if len(group.runs) > group.num_seeds
        ]
        if len(contents) > 1:
            found.append(
                f"These runs are of {len(contents)} versions of the task or its files, which count "
                "as the same here."
            )
        if self.num_others:
            found.append(
                f"{self.num_others} runs differ from the others in several options at once, and "
                "are in figures/runs.csv only."
            )
        return found

    def group(self, method: str) -> Group | None:
        return next((group for group in self.groups if group.method == method), None)


def settings(records: Sequence[FinishedRun]) -> list[Setting]:
    """All settings of the runs, trainings first, gaps last."""
    apart: dict[tuple[bool, bool, bool, str], list[FinishedRun]] = {}
    for record in records:
        gap, first = (bool(record.config.get(name)) for name in ("real_gap", "pretrain_steps"))
        apart.setdefault((gap, first, not record.is_training, record.task), []).append(record)
    found = dict[str, Setting]()
    for setting in (_setting(key, apart[key]) for key in sorted(apart)):
        while setting.key in found:
            setting = replace(setting, number=setting.number + 1)
        found[setting.key] = setting
    return list(found.values())


def _setting(key: tuple[bool, bool, bool, str], records: list[FinishedRun]) -> Setting:
    has_gap, is_pretrained, is_tuning, task = key
    names = dict.fromkeys(name for record in records for name in record.options)
    # {option: methods that use it}: domain randomisation films no real episodes
    users = {n: {record.method for record in records if n in record.options} for n in names}
    usual = _usual(records, users)
    apart: dict[frozenset[str], list[FinishedRun]] = {}
    for record in records:
        own = [(n, v) for n, v in usual.items() if record.method in users[n]]
        differing = frozenset(n for n, v in own if record.options.get(n) != v)
        apart.setdefault(differing, []).append(record)
    common = apart.pop(frozenset(), [])
    ablations = [
        _ablation(next(iter(names)), common, varied)
        for names, varied in apart.items()
        if len(names) == 1
    ]
    ablations.sort(key=lambda ablation: ablation.option)
    return Setting(
        task=task,
        is_training=not is_tuning,
        has_gap=has_gap,
        is_pretrained=is_pretrained,
        groups=_by_method(common),
        ablations=ablations,
        num_others=sum(len(varied) for names, varied in apart.items() if len(names) > 1),
    )


def _usual(records: list[FinishedRun], users: Mapping[str, set[str]]) -> dict[str, Any]:
    """{option: most common value} of varied options; of equally common ones, the first."""
    values = {
        name: [record.options.get(name) for record in records if record.method in methods]
        for name, methods in users.items()
    }
    counts = {name: Counter(map(repr, listed)) for name, listed in values.items()}
    return {
        name: next(v for v in values[name] if repr(v) == count.most_common(1)[0][0])
        for name, count in counts.items()
        if len(count) > 1
    }


def _by_method(records: list[FinishedRun]) -> list[Group]:
    found: dict[str, list[FinishedRun]] = {}
    for record in records:
        found.setdefault(record.method, []).append(record)
    place = {method: i for i, method in enumerate(ORDER)}
    return [Group(m, found[m]) for m in sorted(found, key=lambda m: (place.get(m, len(ORDER)), m))]


def _ablation(option: str, common: list[FinishedRun], varied: list[FinishedRun]) -> Ablation:
    """Methods with varied runs, sorted by the option's value: numbers first, then others."""
    methods = {record.method for record in varied}
    found: dict[str, tuple[Any, list[FinishedRun]]] = {}
    for record in [*(r for r in common if r.method in methods), *varied]:
        value = record.options.get(option)
        found.setdefault(repr(value), (value, []))[1].append(record)
    by_value = [(v, g) for v, records in found.values() for g in _by_method(records)]
    by_value.sort(key=lambda pair: (not is_number(pair[0]), pair[0] if is_number(pair[0]) else 0))
    return Ablation(option, by_value)
