"""Conclusions on each parameter from its sensitivity."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from simtune.checking.sensitivity.parameters import Sensitivity
from simtune.normal import STDS_90
from simtune.parameters import ParameterSpace
from simtune.tuning.combinations import is_useful_power, rounded_weight
from simtune.verdicts import IDENTIFIED_SHARE, WEAK_SHARE

Shows = Literal["shows clearly", "shows weakly", "does not show"]
CLEAR: Shows = "shows clearly"

_MIN_SHARED_CORRELATION = 0.8  # of errors that count as one: (1 + r) / (1 − r) is 9
_NOTHING = "changes neither picture nor motion: it cannot be found from video"
_NOTHING_READ = "changes no reading: it cannot be found from these sensors"
_NOTHING_AT_ALL = "changes neither picture, motion nor readings: it cannot be found from them"


def conclude_on_parameters(
    space: ParameterSpace, sensitivity: Sensitivity, reasons: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """{"parameters": an object each, by name, "pairs": what shows only together}; JSON.

    Keys that end in `_at_best` are of a fit that leaves nothing of recorded readings but their
    noise. `reasons`: why parameters show nowhere, by name, if they do not.
    """
    share, at_best = _share(space, sensitivity, sensitivity.motion_std), None
    if sensitivity.motion_std_at_best is not None:
        at_best = _share(space, sensitivity, sensitivity.motion_std_at_best)
    least = share if at_best is None else at_best
    shows: list[Shows] = [_shows(*both) for both in zip(share, least, strict=True)]
    together = np.abs(np.triu(sensitivity.correlation, 1)) > _MIN_SHARED_CORRELATION
    pairs = [_pair(space, sensitivity, least, i, j) for i, j in np.argwhere(together)]
    reasons = _nothing(space, sensitivity, reasons or {})
    parameters = {
        name: _numbers(space, sensitivity, i)
        | {
            "interval_share": float(share[i]),
            **({} if at_best is None else {"interval_share_at_best": float(at_best[i])}),
            "verdict": shows[i],
            "note": _note(name, reasons.get(name, "") * (shows[i] != CLEAR), pairs),
        }
        for i, name in enumerate(space.names)
    }
    return {"parameters": parameters, "pairs": pairs}


def _share(space: ParameterSpace, sensitivity: Sensitivity, motion_std: np.ndarray) -> np.ndarray:
    """(N,) 90 % intervals' shares of the first range, by (N,) errors of what motion tells."""
    # Parameters that a single picture shows need no motion; the others do, however they look.
    picture_std = np.where(space.is_visible, sensitivity.picture_std, np.inf)
    return 2 * STDS_90 * np.minimum(picture_std, motion_std) / sensitivity.first_width


def _shows(share: float, at_best: float) -> Shows:
    """By the 90 % interval's share of the first search range, like a search's verdict.

    That range is a factor of 3 up and down, or the bounds of a linear scale. "Clearly" is what
    tuning can call identified even if its model leaves much, "does not show" what it cannot even
    call weak at best: no real fit knows more.
    """
    if share <= IDENTIFIED_SHARE:
        return CLEAR
    return "shows weakly" if at_best <= WEAK_SHARE else "does not show"


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
        pictures = sensitivity.pictures
        numbers |= {
            "picture_levels": float(pictures.levels[i]),
            "picture_share": float(pictures.pixel_share[i]),
            "motion_rms_px": float(pictures.rms_px[i]),
            "motion_largest_px": float(pictures.largest_px[i]),
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
    key, unit = ("std_percent", 100) if space.is_log[i] else ("std", 1)
    numbers[key] = unit * std
    if sensitivity.motion_std_at_best is not None:
        numbers[f"{key}_at_best"] = unit * float(sensitivity.motion_std_at_best[i])
    return numbers


def _pair(
    space: ParameterSpace, sensitivity: Sensitivity, share: np.ndarray, i: int, j: int
) -> dict[str, Any]:
    """Two parameters with correlated errors, and the combination that is known.

    `share`: (N,) of the first range, at best.
    """
    names = [space.names[i], space.names[j]]
    correlation = float(sensitivity.correlation[i, j])
    combination = _combination(space, sensitivity, i, j)
    both = max(share[i], share[j]) <= IDENTIFIED_SHARE
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
    slope = rounded_weight(float(ratio))
    are_log = space.is_log[[i, j]]
    if are_log.all() and is_useful_power(slope):
        b = b if slope == 1 else f"{b}^{slope:g}"
        return f"their ratio, {a} / {b}" if rise_together else f"their product, {a} × {b}"
    same_unit = space.parameters[i].unit == space.parameters[j].unit
    if not are_log.any() and same_unit:  # metres and radians cannot be added
        b = b if slope == 1 else f"{slope:g} {b}"
        return f"their difference, {a} − {b}" if rise_together else f"their sum, {a} + {b}"
    return f"a larger {a} looks like a {'smaller' if rise_together else 'larger'} {b}"
