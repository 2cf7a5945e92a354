"""Conclusions on each parameter from its sensitivity."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from simtune.fit.sensitivity import Sensitivity
from simtune.normal import STDS_90
from simtune.parameters import ParameterSpace
from simtune.tuning.range_update import RangeUpdateConfig

Shows = Literal["shows clearly", "shows weakly", "does not show"]
CLEAR: Shows = "shows clearly"

_TOGETHER = 0.8  # correlation from which two errors count as one: (1 + r) / (1 − r) is 9
_NOTHING = "changes neither picture nor motion: it cannot be found from video"
_NOTHING_READ = "changes no reading: it cannot be found from these sensors"
_NOTHING_AT_ALL = "changes neither picture, motion nor readings: it cannot be found from them"


def conclude(
    space: ParameterSpace, sensitivity: Sensitivity, reasons: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """{"parameters": an object each, by name, "pairs": what shows only together}; JSON.

    `reasons`: why parameters show nowhere, by name, if they do not.
    """
    # Parameters that a single picture shows need no motion; the others do, however they look.
    picture_std = np.where(space.is_visible, sensitivity.picture_std, np.inf)
    std = np.minimum(picture_std, sensitivity.motion_std)
    share = 2 * STDS_90 * std / sensitivity.first_width
    shows: list[Shows] = [_shows(s) for s in share]
    together = np.abs(np.triu(sensitivity.correlation, 1)) > _TOGETHER
    pairs = [_pair(space, sensitivity, shows, i, j) for i, j in np.argwhere(together)]
    reasons = _nothing(space, sensitivity, reasons or {})
    parameters = {
        name: _numbers(space, sensitivity, i)
        | {
            "interval_share": float(share[i]),
            "verdict": shows[i],
            "note": _note(name, reasons.get(name, "") * (shows[i] != CLEAR), pairs),
        }
        for i, name in enumerate(space.names)
    }
    return {"parameters": parameters, "pairs": pairs}


def _shows(share: float) -> Shows:
    """By the 90 % interval's share of the first search range, like a search's verdict.

    That range is a factor of 3 up and down, or the bounds of a linear scale. "Clearly" is what
    tuning can call identified, "weakly" what it can call weak, at best: no real fit knows more.
    """
    limits = RangeUpdateConfig()
    if share <= limits.identified_share:
        return CLEAR
    return "shows weakly" if share <= limits.weak_share else "does not show"


def _nothing(
    space: ParameterSpace, sensitivity: Sensitivity, reasons: Mapping[str, str]
) -> dict[str, str]:
    """Notes on parameters that show nowhere."""
    said = _NOTHING_AT_ALL if sensitivity.sees_pictures else _NOTHING_READ
    said = _NOTHING if sensitivity.readings is None else said
    nothing = [space.names[i] for i in np.flatnonzero(sensitivity.shows_nothing)]
    return {name: reasons.get(name, said) for name in nothing}


def _note(name: str, reason: str, pairs: list[dict[str, Any]]) -> str:
    if reason:
        return reason
    named = {n for pair in pairs for n in pair["parameters"] if name in pair["parameters"]}
    return f"together with {', '.join(sorted(named - {name}))}: see below" if named else ""


def _numbers(space: ParameterSpace, sensitivity: Sensitivity, i: int) -> dict[str, Any]:
    parameter, std = space.parameters[i], float(sensitivity.motion_std[i])
    numbers = {
        "unit": parameter.unit,
        "value": float(sensitivity.parameters[i]),
        "changed_to": float(sensitivity.changed[i]),
    }
    if sensitivity.sees_pictures:
        numbers |= {
            "picture_levels": float(sensitivity.levels[i]),
            "picture_share": float(sensitivity.pixel_share[i]),
            "motion_rms_px": float(sensitivity.rms_px[i]),
            "motion_largest_px": float(sensitivity.largest_px[i]),
        }
    if readings := sensitivity.readings:
        main = int(readings.main[i])
        numbers |= {
            "reading": readings.labels[main],  # that changes most
            "reading_unit": readings.units[main],
            "reading_rms": float(readings.rms[i, main]),
            "reading_largest": float(readings.largest[i, main]),
        }
    if parameter.is_appearance:
        return numbers  # pictures show brightness directly: there is no motion to predict from
    return numbers | ({"std_percent": 100 * std} if space.is_log[i] else {"std": std})


def _pair(
    space: ParameterSpace, sensitivity: Sensitivity, shows: list[Shows], i: int, j: int
) -> dict[str, Any]:
    """Two parameters with correlated errors, and the combination that is known."""
    names = [space.names[i], space.names[j]]
    correlation = float(sensitivity.correlation[i, j])
    combination = _combination(space, sensitivity, i, j)
    both = shows[i] == shows[j] == CLEAR
    best = "told better together than alone" if both else "told together only"
    return {
        "parameters": names,
        "correlation": correlation,
        "combination": combination,
        "says": f"{' and '.join(names)}: {best}: {combination} (correlation {correlation:.2f})",
    }


def _combination(space: ParameterSpace, sensitivity: Sensitivity, i: int, j: int) -> str:
    """The combination of two parameters that stays the same when their errors are correlated."""
    a, b = space.names[i], space.names[j]
    rise_together = sensitivity.correlation[i, j] > 0
    ratio = sensitivity.motion_std[i] / sensitivity.motion_std[j]
    slope = 1.0 if 0.75 < ratio < 1.33 else float(f"{ratio:.1g}")
    if space.is_log[i] and space.is_log[j]:
        b = b if slope == 1 else f"{b}^{slope:g}"
        return f"their ratio, {a} / {b}" if rise_together else f"their product, {a} × {b}"
    same_unit = space.parameters[i].unit == space.parameters[j].unit
    if (
        not space.is_log[i] and not space.is_log[j] and same_unit
    ):  # metres and radians cannot be added
        b = b if slope == 1 else f"{slope:g} {b}"
        return f"their difference, {a} − {b}" if rise_together else f"their sum, {a} + {b}"
    return f"a larger {a} looks like a {'smaller' if rise_together else 'larger'} {b}"
