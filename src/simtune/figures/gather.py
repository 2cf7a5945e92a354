"""Makes figures of settings: curves, ablations, and the authors' results for comparison."""

from collections.abc import Sequence
from typing import Any

from simtune.config import UNTUNED
from simtune.figures.authors import AUTHORS
from simtune.figures.curves import Band, interpolated, stepped
from simtune.figures.figure import Figure, Reference, Series
from simtune.figures.groups import Ablation, Group, Setting
from simtune.figures.statistics import centre
from simtune.validate import is_number


def figures_of(setting: Setting) -> list[Figure]:
    """All figures of a setting that are not empty."""
    score = setting.score
    scored = "success, share of episodes" if score == "success" else "return, real world"
    drawn = [
        _learning(setting),
        _against(setting, "step", score, "policy steps", scored),
        _against(setting, "real_episodes", score, "real episodes", scored),
        _errors(setting),
    ]
    for ablation in setting.ablations:
        drawn += [
            _ablated(setting, ablation, name, title)
            for name, title in ((score, scored), ("percent_error", "mean error, %"))
        ]
    return [figure for figure in drawn if not figure.is_empty]


def _learning(setting: Setting) -> Figure:
    series = [
        Series(group.method, group.method, interpolated([run.returns() for run in group.runs]))
        for group in setting.groups
    ]
    return Figure(
        key=f"{setting.key}-learning",
        title="learning in simulation, on pictures",
        x_title="policy steps",
        y_title="return, simulated",
        series=series,
    )


def _against(setting: Setting, against: str, score: str, x: str, y: str) -> Figure:
    """Scores in the pseudo-real world; methods without real episodes are drawn as levels."""
    series = [
        Series(group.method, group.method, stepped(curves), line=True)
        for group in setting.groups
        if (curves := [run.scores(against, score) for run in group.runs])
        and not (against == "real_episodes" and group.method in UNTUNED)
    ]
    references = []
    if against == "real_episodes":
        levels = [g for g in setting.groups if g.method in UNTUNED and g.scores(score)]
        references = [Reference(g.method, centre(g.scores(score)).mean) for g in levels]
    return Figure(
        key=f"{setting.key}-{score}-{against}",
        title=f"{score} against {x}",
        x_title=x,
        y_title=y,
        series=series,
        references=references + _authors(setting, score),
    )


def _authors(setting: Setting, score: str) -> list[Reference]:
    reached = AUTHORS.get(setting.task)
    if not setting.is_training or setting.has_gap or reached is None or reached.score != score:
        return []
    return [Reference("authors' autotune", reached.methods["autotune"].mean)]


def _errors(setting: Setting) -> Figure:
    series = [
        Series(group.method, group.method, stepped([run.percent_errors() for run in group.runs]))
        for group in setting.groups
        if group.method not in UNTUNED
    ]
    reached = AUTHORS.get(setting.task)
    references = []
    if reached and reached.percent_error and not setting.has_gap:
        references = [Reference("authors' end", reached.percent_error[1])]
    return Figure(
        key=f"{setting.key}-error",
        title="percent error against real episodes",
        x_title="real episodes",
        y_title="mean error, %",
        series=series,
        references=references,
    )


def _ablated(setting: Setting, ablation: Ablation, name: str, title: str) -> Figure:
    values = list(dict.fromkeys(repr(value) for value, _ in ablation.groups))
    are_numbers = all(is_number(value) for value, _ in ablation.groups)
    methods = list(dict.fromkeys(group.method for _, group in ablation.groups))

    def band(method: str) -> Band:
        own: Sequence[tuple[Any, Group]] = [p for p in ablation.groups if p[1].method == method]
        places = [(float(v) if are_numbers else float(values.index(repr(v))), g) for v, g in own]
        return [(x, centre(g.scores(name))) for x, g in places if g.scores(name)]

    option = ablation.option.replace("_", " ")
    return Figure(
        key=f"{setting.key}-{ablation.option}-{name}",
        title=f"{name.replace('_', ' ')}, {option} varied",
        x_title=option,
        y_title=title,
        series=[Series(method, method, band(method), line=are_numbers) for method in methods],
        is_ablation=True,
        categories=() if are_numbers else tuple(_shown(v) for v in values),
    )


def _shown(value: str) -> str:
    return {"None": "usual", "True": "on", "False": "off"}.get(value, value.strip("'"))
