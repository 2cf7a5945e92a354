"""Warnings of what a fit found: delays, and parameters at a bound."""

import numpy as np

from simtune.parameters import ParameterSpace

_CLEARLY_LATE_STDS, _CLEARLY_LATE_S = 4.0, 1e-3  # both exceeded: pictures are reported as late
_AT_BOUND = 1e-3  # in unit coordinates
_TOO_LATE = (
    "{} come {:.0f} ms {}, the most that is fitted: the rest of a delay may pass for damping, so "
    "nothing is called identified. Correct their times (latency_s in the tuning file), or declare "
    "a parameter of kind delay."
)


def bound_warnings(space: ParameterSpace, unit: np.ndarray, fitted: np.ndarray) -> dict[str, str]:
    """{name: warning} of parameters that ended at a bound beyond which the truth may lie.

    `unit`: (N,) in unit coordinates; `fitted`: (N,) bool. Nothing lies beyond a low bound of 0, or
    beyond the bounds of a colour.
    """
    at_bound = (unit < _AT_BOUND) & (space.low != 0) | (unit > 1 - _AT_BOUND)
    counts = at_bound & fitted & ~space.is_appearance
    return {
        name: f"{name} ended at a bound of its range: the truth may lie beyond, or the model lacks "
        "something; give it a wider low and high to see"
        for name, is_there in zip(space.names, counts, strict=True)
        if is_there
    }


def latency_warning(latency_steps: int) -> list[str]:
    """One if actions take effect late."""
    if not latency_steps:
        return []
    steps = "1 step" if latency_steps == 1 else f"{latency_steps} steps"
    return [
        f"The actions seem to take effect {steps} later than the recordings say; the "
        "estimates allow for it."
    ]


def lateness_warning(what: str, late_s: float, std: float) -> list[str]:
    """One if pictures or readings are clearly late; `std`: of `late_s`."""
    if abs(late_s) <= max(_CLEARLY_LATE_STDS * std, _CLEARLY_LATE_S):
        return []
    when = "later" if late_s > 0 else "sooner"
    return [
        f"The {what} seem to come {1e3 * abs(late_s):.0f} ms {when} than the recordings say "
        f"(± {_ms(std)} ms); the estimates allow for it."
    ]


def _ms(seconds: float) -> str:
    """Milliseconds with two digits, and no power of ten."""
    return f"{1e3 * seconds:.0f}" if 1e3 * seconds >= 9.95 else f"{1e3 * seconds:.2g}"


def too_late_warning(what: str, late_s: float) -> str:
    """On a lateness at the end of its range."""
    return _TOO_LATE.format(what, 1e3 * abs(late_s), "late" if late_s > 0 else "early")
