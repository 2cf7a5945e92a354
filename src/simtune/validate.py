"""Validation of numbers in files that others wrote."""

from typing import Any, TypeGuard

_HUGE = 1e300  # whole numbers may be larger than any float


def is_number(value: Any) -> TypeGuard[float]:
    """Whether it is a finite number, not a bool."""
    is_real = isinstance(value, int | float) and not isinstance(value, bool)
    return is_real and abs(value) < _HUGE  # false for NaN
