"""Combines the curves of several seeds into one with an interval."""

from collections.abc import Sequence

import numpy as np

from simtune.figures.statistics import Centre, centre

Curve = Sequence[tuple[float, float]]
Band = list[tuple[float, Centre]]

_POINTS = 40  # of a smooth curve


def interpolated(curves: Sequence[Curve]) -> Band:
    """Combine curves measured at different x by linear interpolation, where all are defined."""
    arrays = [np.array(sorted(curve)) for curve in curves if len(curve)]
    if not arrays:
        return []
    start = max(curve[0, 0] for curve in arrays)
    end = min(curve[-1, 0] for curve in arrays)
    if start > end:
        return []
    at = np.unique(np.linspace(start, end, _POINTS))
    values = np.array([np.interp(at, *curve.T) for curve in arrays])
    return [(float(x), centre(list(column))) for x, column in zip(at, values.T, strict=True)]


def stepped(curves: Sequence[Curve]) -> Band:
    """Combine curves whose values hold until the next one, such as estimates.

    The result has a value at every x at which a curve changes, once all have started.
    """
    kept = [dict(curve) for curve in curves if len(curve)]  # the last of several values at one x
    if not kept:
        return []
    start = max(min(curve) for curve in kept)
    places = sorted({x for curve in kept for x in curve if x >= start})
    return [(x, centre([curve[max(k for k in curve if k <= x)] for curve in kept])) for x in places]
