"""Warnings of what a fit found: delays, and parameters at a bound."""

from collections.abc import Mapping

import numpy as np

from simtune.columns import cut, two_digits
from simtune.fit.lateness import is_too_late
from simtune.parameters import ParameterSpace

_CLEARLY_LATE_STDS, _CLEARLY_LATE_S = 4.0, 1e-3  # both exceeded: pictures are reported as late
_BOUND_TOLERANCE = 1e-3  # in unit coordinates
_ENDED_AT_BOUND = (
    "{} ended at a bound of its range: the truth may lie beyond, or the model lacks something; "
    "give it a wider {} to see"
)
_TOO_LATE = (
    "{} come {:.0f} ms late, the most that is fitted: the rest of a delay may pass for damping, so "
    "nothing is called identified. Correct their times (latency_s in the tuning file), or declare "
    "a parameter of kind delay."
)
_TOO_EARLY = (
    "{} come {:.0f} ms early, the most that is fitted: the rest may pass for something else, so "
    "nothing is called identified. Does each row of the recording hold the action before it? Then "
    "move the actions up by a row; else correct the times of either."
)
_MOST_TOLD = 6  # parameters
_OF_TIMESTEP = (
    "The estimates make up for the model's timestep of {} ms. With physics as fine as a robot's, "
    "they would be: {}. Intervals allow for it. A smaller timestep tells the robot's own "
    "values; for a simulator with this one, the estimates are the best."
)


def bound_warnings(space: ParameterSpace, unit: np.ndarray, fitted: np.ndarray) -> dict[str, str]:
    """{name: warning} of parameters that ended at a bound beyond which the truth may lie.

    `unit`: (N,) in unit coordinates; `fitted`: (N,) bool. Nothing lies beyond a low bound of 0 of
    what is never negative, or beyond the bounds of a colour.
    """
    ends = [p.low == 0 and p.field_info.is_never_negative for p in space]
    at_bound = (unit < _BOUND_TOLERANCE) & ~np.array(ends) | (unit > 1 - _BOUND_TOLERANCE)
    counts = at_bound & fitted & ~space.is_appearance
    return {
        parameter.name: _ENDED_AT_BOUND.format(parameter.name, parameter.bound_keys)
        for parameter, is_there in zip(space, counts, strict=True)
        if is_there
    }


def timestep_warning(
    space: ParameterSpace, unit: np.ndarray, change: np.ndarray, timestep_s: float
) -> list[str]:
    """One if the timestep changes some estimates clearly.

    `unit`, `change`: (N,) estimates and their changes without any timestep, in unit coordinates; 0
    where they hardly change.
    """
    at, without = (space.from_unit(np.clip(u, 0, 1)) for u in (unit, unit + change))
    told = []
    for i in sorted(np.flatnonzero(change), key=lambda i: -abs(change[i])):
        more, parameter = without[i] - at[i], space.parameters[i]
        is_relative, how = bool(at[i]), "higher" if more > 0 else "lower"
        size = two_digits(100 * abs(more / at[i]) if is_relative else abs(more))
        told.append(f"{parameter.name} {size} {'%' if is_relative else parameter.unit} {how}")
    return [_OF_TIMESTEP.format(_ms(timestep_s), cut(told, _MOST_TOLD))] if told else []


def delay_warnings(
    late_s: Mapping[str, tuple[float, float]],
    latency_steps: int,
    step_s: float,
) -> list[str]:
    """On late actions and on late pictures or readings; on their sum if both are found.

    `late_s`: {"pictures": (seconds, standard deviation)}.
    """
    told, has_told_actions = [], bool(late_s)
    for what, (late, std) in late_s.items():
        of_itself, is_sum = _lateness_warning(what, late, std), False
        if is_too_late(late / step_s):
            of_itself = [_too_late_warning(what.capitalize(), late)]
        elif latency_steps and of_itself:
            in_all, is_sum = _later(latency_steps * step_s + late, std), True
            of_itself = [f"What an action does shows in {what} {in_all}"]
        told += of_itself
        has_told_actions &= is_sum
    return told if has_told_actions else [*_latency_warning(latency_steps), *told]


def _latency_warning(latency_steps: int) -> list[str]:
    """One if actions take effect late."""
    if not latency_steps:
        return []
    steps = "1 step" if latency_steps == 1 else f"{latency_steps} steps"
    return [
        f"The actions seem to take effect {steps} later than the recordings say; the "
        "estimates allow for it."
    ]


def _lateness_warning(what: str, late_s: float, std: float) -> list[str]:
    """One if pictures or readings are clearly late; `std`: of `late_s`."""
    if abs(late_s) <= max(_CLEARLY_LATE_STDS * std, _CLEARLY_LATE_S):
        return []
    return [f"The {what} seem to come {_later(late_s, std)}"]


def _later(late_s: float, std: float) -> str:
    when = "later" if late_s > 0 else "sooner"
    return (
        f"{1e3 * abs(late_s):.0f} ms {when} than the recordings say (± {_ms(std)} ms); the "
        "estimates allow for it."
    )


def _ms(seconds: float) -> str:
    return two_digits(1e3 * seconds)


def _too_late_warning(what: str, late_s: float) -> str:
    """On a lateness at the end of its range."""
    return (_TOO_LATE if late_s > 0 else _TOO_EARLY).format(what, 1e3 * abs(late_s))
