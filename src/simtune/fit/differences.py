"""How predictions change with parameters and starts: finite differences, all worlds at once."""

from typing import NamedTuple

import numpy as np

from simtune.fit.open_loop import OpenLoop
from simtune.fit.readings import Stretches
from simtune.fit.slopes import Groups, Slopes, agreed

_UNIT_DELTA = 5e-3
_STATE_DELTA = 0.05  # of what is unknown of a state


class Where(NamedTuple):
    """Where it is derived: W stretches, S unknowns of each start, N parameters."""

    stretches: Stretches
    states: np.ndarray  # (W, nq + nv) in which they begin
    unit: np.ndarray  # (N,) in unit coordinates
    start_std: np.ndarray  # (S,) what is unknown of a start, in terms of which it is derived


def differentiate(loop: OpenLoop, where: Where, one_sided: bool = False) -> Slopes:
    """By each parameter and start, by central differences.

    Of two parameters that do the same, such as a servo's kv and its joint's damping, one-sided
    ones would seem to tell which is which, by their own curvature. And after a contact the
    least change may throw a motion elsewhere: a derivative is noise then, and would be taken
    for a reading that tells much. So derivatives count by how well those to both sides agree.
    `one_sided`: to be quicker, and a little wrong, where nothing can touch.
    """
    delta = _deltas(loop, where.unit)
    number = np.arange(len(delta))
    here, there, others = _changed(loop, where, delta, number, one_sided)
    twice = len(others)
    there[:twice] = agreed(there[:twice], others)
    slopes = (there / delta[:, None, None, None]).swapaxes(0, 1)
    num = len(loop.fitted)
    return Slopes(here, slopes[:, :num], slopes[:, num:])


def refresh(loop: OpenLoop, where: Where, slopes: Slopes, groups: Groups) -> Slopes:
    """By few worlds: of each group a reading's main derivative anew; others as they were near by.

    One-sided where nothing can touch.
    """
    delta, num = _deltas(loop, where.unit), len(loop.fitted)
    here, there, others = _changed(loop, where, delta, groups.number, one_sided=True)
    every = np.concatenate([slopes.by_parameter, slopes.by_start], 1).swapaxes(0, 1)  # (U, W, …)
    is_main = np.zeros((len(delta), loop.num_readings), bool)  # (U, D)
    anew = np.flatnonzero(groups.number >= 0)
    number = groups.number[anew]
    is_main[anew] = groups.owner[number] == anew[:, None]
    # What the others of a group change is taken from what it changed in all
    by_others = np.where(is_main[:, None, None], 0.0, every * delta[:, None, None, None])
    of_group = groups.number == np.arange(len(groups.owner))[:, None]  # (G, U)
    side = np.tensordot(of_group.astype(float), by_others, 1)
    there, twice = there - side, len(others)
    there[:twice] = agreed(there[:twice], others - side[:twice])
    changed = there[number] / delta[anew, None, None, None]
    every[anew] = np.where(is_main[anew, None, None], changed, every[anew])
    new = every.swapaxes(0, 1)
    return Slopes(here, new[:, :num], new[:, num:])


def _deltas(loop: OpenLoop, unit: np.ndarray) -> np.ndarray:
    """(U,) by how much unknowns are changed: inward, where they have bounds."""
    of_parameters = np.where(unit[loop.fitted] > 0.5, -_UNIT_DELTA, _UNIT_DELTA)
    return np.concatenate([of_parameters, np.full(len(loop.start_tangents), _STATE_DELTA)])


def _changed(
    loop: OpenLoop, where: Where, delta: np.ndarray, number: np.ndarray, one_sided: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is predicted, and by how much else with unknowns changed, those of a `number` at once.

    Those of -1 are not changed. (W, K + 1, D); (G, W, K + 1, D); and of the first B of them, in
    which parameters change, (B, W, K + 1, D) as seen from the other side. B is 0 if `one_sided`,
    unless something may touch.
    """
    num_groups, num_fitted, unit = number.max() + 1, len(loop.fitted), where.unit
    units = np.repeat(unit[None], num_groups, 0)
    (chosen,) = np.nonzero(number >= 0)
    its, starts = chosen[chosen < num_fitted], chosen[chosen >= num_fitted]
    np.add.at(units, (number[its], loop.fitted[its]), delta[its])
    tangents = np.zeros((num_groups, loop.start_tangents.shape[1]))
    change = (delta[num_fitted:] * where.start_std)[:, None] * loop.start_tangents
    np.add.at(tangents, number[starts], change[starts - num_fitted])
    twice = 0 if one_sided and not loop.may_touch else number[:num_fitted].max(initial=-1) + 1
    back = 2 * unit - units[:twice]
    # At a bound there is no other side: twice as far, then
    is_inside = np.all((back >= 0) & (back <= 1), axis=1)
    side = np.where(is_inside, -1, 2)[:, None]
    units = np.concatenate([unit[None], units, unit + side * (units[:twice] - unit)])
    tangents = np.concatenate([0 * tangents[:1], tangents, side * tangents[:twice]])
    spread = np.repeat(tangents[:, None], len(where.states), 1)
    states = loop.physics.space.move(where.states, spread)
    predicted, _ = loop.play(where.stretches, states, units)
    here, there, beyond = np.split(predicted, [1, 1 + num_groups])
    others = np.where(is_inside[:, None, None, None], here - beyond, beyond - there[:twice])
    return here[0], there - here, others
