"""Derivatives of predictions by parameters and initial states: finite differences, in one batch."""

from typing import NamedTuple

import numpy as np

from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.slopes import Groups, StretchSlopes, agreed
from simtune.fit.readings.stretches import Stretches

UNIT_DELTA = 5e-3
# Times a reading's range in a stretch, or rad, m, or those per second if that is less than 1
_EXPLODED = 100.0
_STATE_DELTA = 0.05  # in units of `start_std`


class DifferencePoint(NamedTuple):
    """At which derivatives are taken: W stretches, S unknowns of an initial state, N parameters."""

    stretches: Stretches
    states: np.ndarray  # (W, nq + nv) initial states
    unit: np.ndarray  # (N,) in unit coordinates
    start_std: np.ndarray  # (S,) prior std of an initial state: the units of its unknowns
    touches: bool = True  # whether anything does in these stretches


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
    here, there, others = changed_together(loop, at, delta, number, one_sided)
    twice = len(others)
    there[:twice] = agreed(there[:twice], others)
    slopes = (there / delta[:, None, None, None]).swapaxes(0, 1)
    num = len(loop.fitted)
    return StretchSlopes(here, slopes[:, :num], slopes[:, num:])


def refresh(
    loop: OpenLoopReplay, at: DifferencePoint, slopes: StretchSlopes, groups: Groups
) -> StretchSlopes:
    """Update derivatives with few worlds: only each reading's main derivative in every group.

    The others keep their values from a point near by. One-sided where nothing touches.
    """
    delta, num = _deltas(loop, at.unit), len(loop.fitted)
    here, there, others = changed_together(loop, at, delta, groups.number, one_sided=True)
    derived = np.concatenate([slopes.by_parameter, slopes.by_start], 1).swapaxes(0, 1)  # (U, W, …)
    is_main = np.zeros((len(delta), loop.measured.num_readings), bool)  # (U, D)
    anew = np.flatnonzero(groups.number >= 0)
    number = groups.number[anew]
    is_main[anew] = groups.owner[number] == anew[:, None]
    # Subtract the (old) effect of the other unknowns in each group
    by_others = np.where(is_main[:, None, None], 0.0, derived * delta[:, None, None, None])
    of_group = groups.number == np.arange(len(groups.owner))[:, None]  # (G, U)
    side = np.tensordot(of_group.astype(float), by_others, 1)
    twice = len(others)
    # What exploded is 0, and stays so
    there, others = (
        np.where(its.any((2, 3), keepdims=True), its - side[: len(its)], 0.0)
        for its in (there, others)
    )
    there[:twice] = agreed(there[:twice], others)
    changed = there[number] / delta[anew, None, None, None]
    derived[anew] = np.where(is_main[anew, None, None], changed, derived[anew])
    new = derived.swapaxes(0, 1)
    return StretchSlopes(here, new[:, :num], new[:, num:])


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
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predictions, and their changes when all unknowns with the same group `number` change at once.

    Unknowns of number −1 stay. Returns (W, K + 1, D) predictions; (G, W, K + 1, D) changes; and,
    for the first B groups, which change parameters, (B, W, K + 1, D) changes seen from the other
    side. B is 0 if `one_sided`, unless something touches.
    """
    num_groups, num_fitted, unit = number.max() + 1, len(loop.fitted), at.unit
    units = np.repeat(unit[None], num_groups, 0)
    (chosen,) = np.nonzero(number >= 0)
    parameters, starts = chosen[chosen < num_fitted], chosen[chosen >= num_fitted]
    np.add.at(units, (number[parameters], loop.fitted[parameters]), delta[parameters])
    tangents = np.zeros((num_groups, loop.measured.start_tangents.shape[1]))
    change = (delta[num_fitted:] * at.start_std)[:, None] * loop.measured.start_tangents
    np.add.at(tangents, number[starts], change[starts - num_fitted])
    twice = 0 if one_sided and not at.touches else number[:num_fitted].max(initial=-1) + 1
    back = 2 * unit - units[:twice]
    # At a bound there is no other side: step twice as far instead
    is_inside = np.all((back >= 0) & (back <= 1), axis=1)
    side = np.where(is_inside, -1, 2)[:, None]
    units = np.concatenate([unit[None], units, unit + side * (units[:twice] - unit)])
    unmoved = np.zeros((1, tangents.shape[1]))
    tangents = np.concatenate([unmoved, tangents, side * tangents[:twice]])
    spread = np.repeat(tangents[:, None], len(at.states), 1)
    states = loop.measured.along(at.states, spread)
    predicted, _ = loop.play(at.stretches, states, units)
    here, there, beyond = np.split(predicted, [1, 1 + num_groups])
    others = np.where(is_inside[:, None, None, None], here - beyond, beyond - there[:twice])
    most = _EXPLODED * np.maximum(at.stretches.travel[:, None], 1.0)
    return here[0], _unless_exploded(there - here, most), _unless_exploded(others, most)


def _unless_exploded(changes: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(G, W, K + 1, D) changes, 0 in stretches where a small step changes a reading by `most`.

    As of worlds that explode, which tell nothing, and whose squares outgrow all others. A flywheel
    turns far. `most`: (W, 1, D).
    """
    exploded = ~(np.abs(changes) < most).all((2, 3), keepdims=True)
    return np.where(exploded, 0.0, changes)
