"""The section "How far to trust this": what known worlds showed, and what goes together."""

from math import log
from typing import Any

from simtune.report.data import RunData
from simtune.report.rank_plots import rank_dots, rank_histogram
from simtune.report.words import text
from simtune.validate import is_number

_WITHIN = (0.05, 0.95)  # ranks of truths that a central 90 % interval holds

_READING = (
    "<p class='legend'><span><i class='expected'></i>where nine of ten bars end, if intervals are "
    "right and parameters independent</span><span>first plot: how many ranks are in each tenth · "
    "second: a row a parameter, the 90 % interval shaded</span></p>"
    "<p class='note'>A rank is the probability that a fit gave to values below the truth. Bars "
    "high at both ends: intervals are too narrow. High in the middle: wider than need be. High "
    "at one end: estimates lean to the other side.</p>"
)


def trust(run: RunData) -> str:
    """Empty for a run that tells nothing of it."""
    shown = _known_worlds(_ranks(run)) + _correlations(run)
    section = f"<section class='trust'><h2>How far to trust this</h2>{shown}</section>"
    return section if shown else ""


def _ranks(run: RunData) -> dict[str, list[float]]:
    """Ranks by parameter; whatever else is in their place is left out."""
    given = _object(run, "ranks")
    ranks = {
        name: [r for r in listed if is_number(r) and 0 <= r <= 1]
        for name, listed in given.items()
        if isinstance(listed, list)
    }
    return {name: listed for name, listed in ranks.items() if listed}


def _object(run: RunData, key: str) -> dict[str, Any]:
    value = run.result.get(key)
    return value if isinstance(value, dict) else {}


def _known_worlds(ranks: dict[str, list[float]]) -> str:
    """How often intervals of known worlds held the truth, in words and as plots."""
    if not ranks:
        return ""
    every = [rank for listed in ranks.values() for rank in listed]
    low, high = _WITHIN
    held = sum(low <= rank <= high for rank in every)
    num = max(len(listed) for listed in ranks.values())
    worlds = "1 known world" if num == 1 else f"{num} known worlds"
    return (
        f"<p><b>{worlds}, filmed and fitted in the same way: {held} of {len(every)} of the 90 % "
        f"intervals held the truth</b>; {round(0.9 * len(every))} should. They are simulated near "
        "the estimate and play the same actions; for what the simulator lacks they are no test.</p>"
        f"<div class='ranks'>{rank_histogram(every)}{rank_dots(ranks)}</div>{_READING}"
    )


def _correlations(run: RunData) -> str:
    """A sentence for each pair that the motion can hardly tell from each other."""
    known, items = run.parameters, []
    for pair, value in _object(run, "correlations").items():
        a, _, b = pair.partition(", ")
        if a in known and b in known and is_number(value):
            together = "raising both" if value > 0 else "raising one and lowering the other"
            items.append(
                f"<li><b>{text(a)}</b> and <b>{text(b)}</b>: {together} changes the motion least, "
                f"so {_told(known, a, b, value > 0)} (correlation {_signed(value)}).</li>"
            )
    return f"<h3>Told together better than alone</h3><ul>{''.join(items)}</ul>" if items else ""


def _signed(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")


def _told(known: dict[str, dict[str, Any]], a: str, b: str, rise_together: bool) -> str:
    """Which combination of two parameters the motion tells, in words."""
    width_a, width_b = _log_width(known[a]), _log_width(known[b])
    if width_a is None or width_b is None:  # of what may be negative there is no ratio
        return "neither is told well alone"
    power = width_a / width_b
    power = 1.0 if 0.75 < power < 1.33 else float(f"{power:.1g}")
    factor = text(b) if power == 1 else f"{text(b)}<sup>{power:g}</sup>"
    if rise_together:
        return f"their ratio, {text(a)} / {factor}, is told better than either alone"
    return f"their product, {text(a)} · {factor}, is told better than either alone"


def _log_width(parameter: dict[str, Any]) -> float | None:
    """Of the 90 % interval; none where it is not known or holds zero."""
    low, high = parameter.get("low"), parameter.get("high")
    return log(high / low) if is_number(low) and is_number(high) and 0 < low < high else None
