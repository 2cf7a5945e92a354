"""Noise of readings by how rough they are, without a model of how their joints move."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.normal import MAD_TO_STD

# Of differences: smooth motion leaves less in higher ones, noise as much
_DIFFERENCE_ORDERS = range(2, 7)
_MIN_RESOLUTION_SHARE = 1e-5  # of a joint's travel: no encoder is finer
_REPEATED_BY_CHANCE = 0.1  # of a row: noise repeats itself now and then
_MOST_ROWS = 4  # of which one is taken
# Times as large are second differences of smooth motion over twice as many rows, higher ones more
_MOTION_RATIO = 4.0
_LEVEL_RATIO = 1.25  # of the two orders that leave least: motion leaves less in each higher one
_MIN_DIFFERENCES = 20

_Read = Sequence[tuple[np.ndarray, np.ndarray]]  # rows and readings of each episode


def roughness(episodes: Sequence[np.ndarray]) -> float:
    """Standard deviation of white noise in a joint's (T + 1,) readings; NaN where nothing is read.

    By divided differences, which any rows may lack. Motion adds to them, so the order that leaves
    least counts, by its median, as jerks are few. Readings are no finer than their steps, which are
    half a step off at most. NaN if they never change.

    Held or interpolated rows are no readings of their own: of several rows one is taken. What was
    interpolated at another rate lacks the noise of the highest frequencies, which every other row
    has; if these tell much more in several orders alike, that is no motion.
    """
    known = [np.flatnonzero(np.isfinite(values)) for values in episodes]
    read = [(rows, values[rows]) for rows, values in zip(known, episodes, strict=True)]
    values = np.concatenate([known_values for _, known_values in read])
    travel = float(np.ptp(values)) if len(values) else 0.0
    if not travel > 0:
        return math.nan
    changes = np.abs(np.concatenate([np.diff(known_values) for _, known_values in read]))
    finest = _MIN_RESOLUTION_SHARE * travel
    step = changes[changes > finest].min(initial=travel)
    rows = _rows_of_a_reading(read, finest)
    (noise, _), (of_fewer, next_least) = (
        _of_every(num, read) for num in (rows, min(2 * rows, _MOST_ROWS))
    )
    if noise < of_fewer < _MOTION_RATIO * noise and next_least < _LEVEL_RATIO * of_fewer:
        noise = of_fewer
    return float(max(step / math.sqrt(12), min(noise, travel)))


def _rows_of_a_reading(read: _Read, finest: float) -> int:
    """Of n rows with one reading all but one go on level, if held, or straight, if interpolated."""
    sizes = [_sizes(read, order) for order in (1, 2)]
    own = min((np.mean(size > finest) for size in sizes if len(size)), default=1.0)
    return math.ceil(min(1 / max(own, 1e-9) - _REPEATED_BY_CHANCE, _MOST_ROWS))


def _of_every(num: int, read: _Read) -> tuple[float, float]:
    """By every so many readings, from the first that leaves most; see `_by_order`."""
    found = (_by_order([(t[i::num], values[i::num]) for t, values in read]) for i in range(num))
    some = [least for least in found if least[0] < math.inf]
    return max(some, default=(math.inf, math.inf))


def _by_order(read: _Read) -> tuple[float, float]:
    """By the two orders of differences that leave least; infinite if no readings are left."""
    sizes = (_sizes(read, order) for order in _DIFFERENCE_ORDERS)
    found = [float(MAD_TO_STD * np.median(size)) for size in sizes if len(size)]
    least, next_least, *_ = sorted([*found, math.inf, math.inf])
    return least, next_least


def _sizes(read: _Read, order: int) -> np.ndarray:
    """Of all differences of one order, as large as the noise of one reading would make them.

    Where enough of them are of readings at equal distances, of these alone: a held reading is older
    than its row, so beside a lost row its distance is not what it seems.
    """
    sizes, is_even = list[np.ndarray](), list[np.ndarray]()
    gaps = np.concatenate([np.diff(rows) for rows, _ in read])
    usual = np.median(gaps) if len(gaps) else 0.0
    for rows, values in read:
        num = max(0, len(rows) - order)
        at = [rows[i : i + num] for i in range(order + 1)]
        weights = [1.0 / np.prod([t - u for u in at if u is not t], 0) for t in at]
        away = sum(w * values[i : i + num] for i, w in enumerate(weights))
        sizes.append(np.abs(away) / np.sqrt(sum(np.square(w) for w in weights)))
        is_even.append(at[-1] - at[0] == order * usual)
    found, even = np.concatenate(sizes), np.concatenate(is_even)
    return found[even] if even.sum() >= _MIN_DIFFERENCES else found
