"""What the lines of whole runs of one task say together."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from simtune.parameters import ParameterSpace
from whole.lines import Line, figure

_FAR_OFF_PERCENT = 10.0  # no parameter that is called identified should be
_GRACE, _GRACE_S = 1.1, 10.0  # by which a run may take longer than its budget


def summary(lines: Sequence[Line], space: ParameterSpace) -> dict[str, Any]:
    """Shares of intervals and runs, median errors in percent; None where no run ended well."""
    done = [line for line in lines if "failed" not in line]
    figures: dict[str, Any] = {"runs": len(done), "failed": len(lines) - len(done)}
    if not done:
        return figures
    coverage = {name: _share(line["holds"][name] for line in done) for name in space.names}
    lowest = min(coverage, key=coverage.__getitem__)
    moving = [p.name for p in space if not p.is_appearance]
    colours = [p.name for p in space if p.is_appearance]
    return figures | {
        "coverage": _share(holds for line in done for holds in line["holds"].values()),
        "lowest": {lowest: coverage[lowest]},
        "coverage_of_each": coverage,
        "coverage_by_cores": {
            str(cores): _share(h for x in done if x["cores"] == cores for h in x["holds"].values())
            for cores in sorted({line["cores"] for line in done})
        },
        "warned": _share(bool(line["warnings"]) for line in done),
        "wrong_unwarned": _share(is_wrong_unwarned(line) for line in done),
        "dynamics_percent_error": _median_error(done, moving),
        "colours_percent_error": _median_error(done, colours),
        "identified_far_off": far_off(done),
        "wall_to_budget": figure(max(line["wall_s"] / (60 * line["minutes"]) for line in done)),
        "late": sum(map(is_late, done)),
        **origin(done),
    }


def is_wrong_unwarned(line: Line) -> bool:
    """Whether fewer than half of its intervals hold, and it did not warn."""
    held = sum(line["holds"].values())
    return held < len(line["holds"]) / 2 and not line["warnings"]


def is_late(line: Line) -> bool:
    """Whether it took more than a tenth and ten seconds longer than it was given."""
    return line["wall_s"] > _GRACE * 60 * line["minutes"] + _GRACE_S


def far_off(lines: Iterable[Line]) -> list[str]:
    """What was called identified and is more than 10 % off: which, of which seed, by how much."""
    return [
        f"{name} of {line['seed']}: {error:.1f} %"
        for line in lines
        for name, error in line["errors"].items()
        if line["verdicts"][name] == "identified" and error > _FAR_OFF_PERCENT
    ]


def failures(lines: Iterable[Line]) -> list[str]:
    return [f"{x['task']} {x['seed']}: {x['failed']}" for x in lines if "failed" in x]


def origin(lines: Sequence[Line]) -> dict[str, str]:
    """Commits and the last date of lines that may have been measured long before they are read."""
    commits = dict.fromkeys(str(line["commit"]) for line in lines)
    return {"commit": ", ".join(commits), "date": max(line["date"] for line in lines)}


def median_s(seconds: Sequence[float | None]) -> float | None:
    """The median, where None is longer than any; None where that is the median itself."""
    middle = float(np.median([math.inf if s is None else s for s in seconds]))
    return round(middle, 1) if math.isfinite(middle) else None


def _share(those: Iterable[bool]) -> float:
    return round(float(np.mean(list(those))), 3)


def _median_error(lines: Sequence[Line], names: Sequence[str]) -> float | None:
    errors = [line["errors"][name] for line in lines for name in names]
    return figure(float(np.median(errors))) if errors else None
