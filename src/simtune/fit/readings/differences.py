"""Derivatives of predictions by parameters and initial states: finite differences, in one batch."""

from typing import NamedTuple

import numpy as np

from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.segments import Stretches
from simtune.fit.readings.slopes import Groups, StretchSlopes, agreed

UNIT_DELTA = 5e-3
# Times a reading's range in a stretch, or rad, m, or those per second if that is less than 1
_EXPLODED_RANGES = 100.0
_STATE_DELTA = 0.05  # in units of `start_std`


class DifferencePoint(NamedTuple):
    """At which derivatives are taken: W stretches, S unknowns of an initial state, N parameters."""

    stretches: Stretches
    states: np.ndarray  # (W, nq + nv) initial states
    unit: np.ndarray  # (N,) in unit coordinates
    start_std: np.ndarray  # (S,) prior std of an initial state: the units of its unknowns
    touches: bool = True  # whether anything does in these stretches


class Changes(NamedTuple):
    """Predictions of W stretches, and how they change with each of G groups of unknowns."""

    here: np.ndarray  # (W, K + 1, D)
    there: np.ndarray  # (G, W, K + 1, D) changes when a group's unknowns change at once
    # (B, W, K + 1, D) the same, seen from the other side, of the first B groups
    other_side: np.ndarray

    def agreed(self) -> np.ndarray:
        """(G, W, K + 1, D) changes, of the first B groups as far as both sides agree."""
        both = len(self.other_side)
        return np.concatenate([agreed(self.there[:both], self.other_side), self.there[both:]])

    def less(self, others: np.ndarray) -> "Changes":
        """Without what (G, W, K + 1, D) `others` make of them. What exploded is 0, and stays so."""
        there, other_side = (
            np.where(its.any((2, 3), keepdims=True), its - others[: len(its)], 0.0)
            for its in (self.there, self.other_side)
        )
        return Changes(self.here, there, other_side)


def differentiate(
    loop: OpenLoopReplay, at: DifferencePoint, one_sided: bool = False
) -> StretchSlopes:
    """Derivatives by each parameter and initial state, by central differences.

    One-sided differences would seem to separate parameters with the same effect, such as a servo's
    kv and its joint's damping, by their curvature. After a contact the smallest change may lead
    elsewhere; such a derivative is noise, but looks very informative. So derivatives are shrunk by
    how well both sides agree. `one_sided`: faster and slightly wrong, used where nothing touches.
    """
    delta = _deltas(loop, at.unit)
    number = np.arange(len(delta))
    changes = changed_together(loop, at, delta, number, one_sided)
    slopes = (changes.agreed() / delta[:, None, None, None]).swapaxes(0, 1)
    num = len(loop.fitted)
    return StretchSlopes(changes.here, slopes[:, :num], slopes[:, num:])


def refresh(
    loop: OpenLoopReplay, at: DifferencePoint, slopes: StretchSlopes, groups: Groups
) -> StretchSlopes:
    """Update derivatives with few worlds: only each reading's main derivative in every group.

    The others keep their values from a point near by. One-sided where nothing touches.
    """
    delta, num = _deltas(loop, at.unit), len(loop.fitted)
    changes = changed_together(loop, at, delta, groups.number, one_sided=True)
    derived = np.concatenate([slopes.by_parameter, slopes.by_start], 1).swapaxes(0, 1)  # (U, W, …)
    is_main = np.zeros((len(delta), loop.measured.num_readings), bool)  # (U, D)
    anew = np.flatnonzero(groups.number >= 0)
    number = groups.number[anew]
    is_main[anew] = groups.owner[number] == anew[:, None]
    # Subtract the (old) effect of the other unknowns in each group
    by_others = np.where(is_main[:, None, None], 0.0, derived * delta[:, None, None, None])
    of_group = groups.number == np.arange(len(groups.owner))[:, None]  # (G, U)
    there = changes.less(np.tensordot(of_group.astype(float), by_others, 1)).agreed()
    changed = there[number] / delta[anew, None, None, None]
    derived[anew] = np.where(is_main[anew, None, None], changed, derived[anew])
    new = derived.swapaxes(0, 1)
    return StretchSlopes(changes.here, new[:, :num], new[:, num:])


def _deltas(loop: OpenLoopReplay, unit: np.ndarray) -> np.ndarray:
    """(U,) step of each unknown; of a bounded one, inward."""
    of_parameters = np.where(unit[loop.fitted] > 0.5, -UNIT_DELTA, UNIT_DELTA)
    return np.concatenate([of_parameters, np.full(len(loop.measured.start_tangents), _STATE_DELTA)])


def changed_together(
    loop: OpenLoopReplay,
    at: DifferencePoint,
    delta: np.ndarray,
    number: np.ndarray,
    one_sided: bool,
) -> Changes:
    """All unknowns with the same group `number` change at once; those of number −1 stay.

    The first groups, which change parameters, are seen from the other side as well, but not if
    `one_sided`, unless something touches.
    """
    unit, (units, tangents) = at.unit, _steps(loop, at, delta, number)
    both = number[: len(loop.fitted)].max(initial=-1) + 1
    if one_sided and not at.touches:
        both = 0
    back = 2 * unit - units[:both]
    # At a bound there is no other side: step twice as far instead
    is_inside = np.all((back >= 0) & (back <= 1), axis=1)
    times = np.where(is_inside, -1, 2)[:, None]
    all_units = np.concatenate([unit[None], units, unit + times * (units[:both] - unit)])
    unmoved = np.zeros((1, tangents.shape[1]))
    all_tangents = np.concatenate([unmoved, tangents, times * tangents[:both]])
    spread = np.repeat(all_tangents[:, None], len(at.states), 1)
    predicted, _ = loop.play(at.stretches, loop.measured.along(at.states, spread), all_units)
    here, there, beyond = np.split(predicted, [1, 1 + len(units)])
    other_side = np.where(is_inside[:, None, None, None], here - beyond, beyond - there[:both])
    most = _EXPLODED_RANGES * np.maximum(at.stretches.travel[:, None], 1.0)
    kept = (_unless_exploded(its, most) for its in (there - here, other_side))
    return Changes(here[0], *kept)


def _steps(
    loop: OpenLoopReplay, at: DifferencePoint, delta: np.ndarray, number: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(G, N) unit coordinates, and (G, 2 nv) tangents of the initial state, of each group."""
    num_groups, num_fitted = number.max() + 1, len(loop.fitted)
    units = np.repeat(at.unit[None], num_groups, 0)
    (chosen,) = np.nonzero(number >= 0)
    parameters, starts = chosen[chosen < num_fitted], chosen[chosen >= num_fitted]
    np.add.at(units, (number[parameters], loop.fitted[parameters]), delta[parameters])
    tangents = np.zeros((num_groups, loop.measured.start_tangents.shape[1]))
    change = (delta[num_fitted:] * at.start_std)[:, None] * loop.measured.start_tangents
    np.add.at(tangents, number[starts], change[starts - num_fitted])
    return units, tangents


def _unless_exploded(changes: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(G, W, K + 1, D) changes, 0 in stretches where a small step changes a reading by `most`.

    As of worlds that explode, which tell nothing, and whose squares outgrow all others. A flywheel
    turns far. `most`: (W, 1, D).
    """
    exploded = ~(np.abs(changes) < most).all((2, 3), keepdims=True)
    return np.where(exploded, 0.0, changes)
