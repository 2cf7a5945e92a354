"""Numbers that are given for actions: one for all, or one for each."""

from collections.abc import Sequence

import numpy as np

from simtune.errors import InputError


def each(what: str, given: np.ndarray | Sequence[float] | float, ids: np.ndarray) -> np.ndarray:
    """(A,) a number for each action, from one or from as many."""
    values = _numbers(given)
    if values.ndim and values.shape != ids.shape:
        count = f"{len(ids)} of them, one for each action"
        raise InputError(f"{what} must be a number, or {count}; got {given}")
    return np.broadcast_to(values, ids.shape)


def _numbers(given: np.ndarray | Sequence | float) -> np.ndarray:
    """An array; an empty (0, 0) one for ragged lists, which no caller accepts."""
    try:
        return np.array(given, float)
    except ValueError:
        return np.empty((0, 0))


def finite_range(given: np.ndarray | Sequence | None, num: int) -> np.ndarray:
    """(num, 2) from None, one pair or as many. Raises InputError."""
    pairs = checked_range([-1.0, 1.0] if given is None else given, num)
    if not np.isfinite(pairs).all():
        raise InputError(f"actions are drawn from their range: it must be finite, got {given}")
    return pairs


def checked_range(given: np.ndarray | Sequence, num: int) -> np.ndarray:
    """(num, 2) from one pair or as many, whose ends may be infinite. Raises InputError."""
    pairs = _numbers(given)
    if pairs.shape not in ((2,), (num, 2)):
        raise InputError(
            f"expected a range [low, high] or {num} of them, one for each action; got {given}"
        )
    if not (pairs[..., 0] < pairs[..., 1]).all():
        raise InputError(f"a range's low must be below its high, got {given}")
    return np.broadcast_to(pairs, (num, 2))
