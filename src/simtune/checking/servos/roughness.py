"""Noise of readings by how rough they are, without a model of how their joints move."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.normal import MAD_TO_STD

# Of differences: smooth motion leaves less in higher ones, noise as much
_ORDERS = range(2, 7)
_FINEST = 1e-5  # of a joint's travel: no encoder is finer
_LONG = 1.5  # times the mean gap between readings
_HARDLY = 0.1  # of a row: noise repeats itself now and then
_MOST_ROWS = 4  # of which one is taken
# Times as large are second differences of smooth motion over twice as many rows, higher ones more
_MOTION = 4.0


def roughness(episodes: Sequence[np.ndarray]) -> float:
    """Standard deviation of white noise in a joint's (T + 1,) readings; NaN where nothing is read.

    The k-th differences of noise have binomial(2k, k) times its variance. Motion adds to them, so
    the order that leaves least counts, by its median, as jerks are few. Readings are no finer than
    their steps, which are half a step off at most. NaN if they never change.

    Rows that are regularly empty are left out. Held or interpolated rows are no readings of their
    own: of several rows one is taken. What was interpolated at another rate lacks the noise of the
    highest frequencies, which every other row has; if these tell much more, that is motion.
    """
    read = [_without_gaps(values) for values in episodes]
    values = np.concatenate(read)
    values = values[np.isfinite(values)]
    travel = float(np.ptp(values)) if len(values) else 0.0
    if not travel > 0:
        return math.nan
    changes, finest = _sizes(read, 1), _FINEST * travel
    step = changes[changes > finest].min(initial=travel)
    rows = _rows_of_a_reading(read, finest)
    noise, of_fewer = (_of_every(n, read) for n in (rows, min(2 * rows, _MOST_ROWS)))
    if noise < of_fewer < _MOTION * noise:
        noise = of_fewer
    return float(max(step / math.sqrt(12), min(noise, travel)))


def _without_gaps(values: np.ndarray) -> np.ndarray:
    """An episode's readings, and between them NaN where more is missing than usual."""
    at = np.flatnonzero(np.isfinite(values))
    gaps = np.diff(at)
    long = 1 + np.flatnonzero(gaps > _LONG * gaps.mean()) if len(gaps) else gaps
    return np.insert(values[at], np.repeat(long, _MOST_ROWS), np.nan)


def _rows_of_a_reading(read: Sequence[np.ndarray], finest: float) -> int:
    """Of n rows with one reading all but one go on level, if held, or straight, if interpolated."""
    sizes = [_sizes(read, order) for order in (1, 2)]
    own = min((np.mean(its > finest) for its in sizes if len(its)), default=1.0)
    return math.ceil(min(1 / max(own, 1e-9) - _HARDLY, _MOST_ROWS))


def _of_every(rows: int, read: Sequence[np.ndarray]) -> float:
    """By every so many rows, from the first that leaves most; infinite if these are too few."""
    found = (_by_order([values[first::rows] for values in read]) for first in range(rows))
    return max((noise for noise in found if noise < math.inf), default=math.inf)


def _by_order(read: Sequence[np.ndarray]) -> float:
    """By differences of the order that leaves least; infinite if no readings are left."""
    least = math.inf
    for order in _ORDERS:
        if len(sizes := _sizes(read, order)):
            per_noise = math.sqrt(math.comb(2 * order, order))
            least = min(least, float(MAD_TO_STD * np.median(sizes) / per_noise))
    return least


def _sizes(read: Sequence[np.ndarray], order: int) -> np.ndarray:
    """Of all differences of one order between readings."""
    sizes = np.abs(np.concatenate([np.diff(values, order) for values in read]))
    return sizes[np.isfinite(sizes)]
