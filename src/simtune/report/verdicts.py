"""What a parameter's verdict means for whoever uses the number, in a sentence."""

from typing import Any

from simtune.report.words import number
from simtune.validate import is_number

_MEANS = {
    "identified": "take the estimate",
    "weak": "take the interval, not the estimate",
    "not identifiable": "these videos do not tell; other actions, or another view, may",
}


def explanation(parameter: dict[str, Any], is_colour: bool) -> str:
    """How far the interval reaches, and what to do; empty where that is unknown."""
    mean, low, high, verdict = (parameter.get(key) for key in ("mean", "low", "high", "verdict"))
    if verdict not in _MEANS or not (is_number(mean) and is_number(low) and is_number(high)):
        return ""
    below, above = mean - low, high - mean
    if is_colour or low <= 0:
        reach = f"{number(below)} below and {number(above)} above the estimate"
    else:
        reach = f"{_percent(below / mean)} below and {_percent(above / mean)} above the estimate"
    return f"The interval reaches {reach}: {_MEANS[verdict]}."


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share < 0.1 else f"{100 * share:,.0f} %"
