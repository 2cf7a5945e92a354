"""Derivatives along what readings hardly tell, taken for themselves.

A mass, its inertias and all forces times one factor give the same motion. The derivatives by each
are large and cancel, but for their errors of some thousandths, which seem to tell that factor to a
percent. So where a combination of parameters changes little, it is moved as a whole.
"""

import numpy as np

from simtune.fit.readings.differences import UNIT_DELTA, DifferencePoint, changed_together
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.slopes import StretchSlopes

_WEAK_INFORMATION = 1e-2  # relative to what the single parameters have
_MIN_INFORMATION = 1.0  # in unit coordinates: what has less, no reading shows
_MAX_DIRECTIONS = 3
MOST_WORLDS = 3 * _MAX_DIRECTIONS  # that are played for all of them


def sharpened(
    loop: OpenLoopReplay, at: DifferencePoint, slopes: StretchSlopes, information: np.ndarray
) -> StretchSlopes:
    """Slopes that are right along weak directions, changed as little as can be.

    `information`: (P + others, P + others), which `slopes` give; the others are marginalised. With
    P derivatives J, their scale S = diag(I)^½ and an eigenvector v of S⁻¹ I S⁻¹ with a small
    eigenvalue, the parameters move along c = S⁻¹ v, readings change by d, and

        J ← J + (d − J c) (S v)ᵀ

    is d along c, and unchanged along what other eigenvectors stand for.
    """
    num = len(loop.fitted)
    own, mixed, others = information[:num, :num], information[:num, num:], information[num:, num:]
    own = own - mixed @ np.linalg.pinv(others) @ mixed.T
    shown = np.flatnonzero(np.diag(own) > _MIN_INFORMATION)
    scale = np.sqrt(np.diag(own)[shown])
    values, vectors = np.linalg.eigh(own[np.ix_(shown, shown)] / np.outer(scale, scale))
    by_parameter = slopes.by_parameter.copy()
    for v in vectors.T[values < _WEAK_INFORMATION][:_MAX_DIRECTIONS]:
        c, back = np.zeros(num), np.zeros(num)
        c[shown], back[shown] = v / scale, v * scale
        left = _along(loop, at, c) - np.einsum("p,wpkd->wkd", c, by_parameter)
        by_parameter += np.einsum("wkd,p->wpkd", left, back)
    return slopes._replace(by_parameter=by_parameter)


def _along(loop: OpenLoopReplay, at: DifferencePoint, direction: np.ndarray) -> np.ndarray:
    """(W, K + 1, D) derivative along (P,) `direction`, a little off bounds that are in the way."""
    length = UNIT_DELTA / np.abs(direction).max()
    step, unit = length * direction, at.unit.copy()
    unit[loop.fitted] = np.clip(unit[loop.fitted], np.abs(step), 1 - np.abs(step))
    delta = np.concatenate([step, np.zeros(len(at.start_std))])
    together = np.where(np.arange(len(delta)) < len(step), 0, -1)
    at = at._replace(unit=unit)
    changes = changed_together(loop, at, delta, together, one_sided=False)
    return changes.agreed()[0] / length
