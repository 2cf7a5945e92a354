"""How far to trust the estimates: what known worlds showed, and what goes together."""

from dataclasses import dataclass
from math import log
from typing import Any

from simtune.report.data import RunData
from simtune.validate import is_number


def ranks(run: RunData) -> dict[str, list[float]]:
    """Of the truths in known worlds, by parameter; whatever else is in their place is left out."""
    given = {n: listed for n, listed in run.object("ranks").items() if isinstance(listed, list)}
    found = {n: [r for r in listed if is_number(r) and 0 <= r <= 1] for n, listed in given.items()}
    return {name: listed for name, listed in found.items() if listed}


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two parameters that the motion can hardly tell from each other."""

    a: str
    b: str
    correlation: float
    power: float | None  # a / b^power, or a · b^power, is told best; None: neither is


def pairs(run: RunData) -> list[Pair]:
    known, found = run.parameters, []
    for names, value in run.object("correlations").items():
        a, _, b = names.partition(", ")
        if a in known and b in known and is_number(value):
            found.append(Pair(a=a, b=b, correlation=value, power=_power(known[a], known[b])))
    return found


def _power(a: dict[str, Any], b: dict[str, Any]) -> float | None:
    width_a, width_b = _log_width(a), _log_width(b)
    if width_a is None or width_b is None:  # of what may be negative there is no ratio
        return None
    power = width_a / width_b
    return 1.0 if 0.75 < power < 1.33 else float(f"{power:.1g}")


def _log_width(parameter: dict[str, Any]) -> float | None:
    """Of the 90 % interval; None where it is not known or holds zero."""
    low, high = parameter.get("low"), parameter.get("high")
    return log(high / low) if is_number(low) and is_number(high) and 0 < low < high else None
