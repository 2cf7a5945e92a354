"""How predictions change with parameters and starts: finite differences, all worlds at once."""

import numpy as np

from simtune.fit.open_loop import OpenLoop
from simtune.fit.readings import Stretches
from simtune.fit.slopes import Groups, Slopes, agreed

_UNIT_DELTA = 5e-3
_STATE_DELTA = 0.05  # of what is unknown of a state


def differentiate(
    loop: OpenLoop,
    stretches: Stretches,
    states: np.ndarray,
    unit: np.ndarray,
    start_std: np.ndarray,
    groups: Groups | None = None,
) -> Slopes:
    """By central differences, at (W, nq + nv) starts and (N,) parameters in unit coordinates.

    Of two parameters that do the same, such as a servo's kv and its joint's damping, one-sided
    ones would seem to tell which is which, by their own curvature. And after a contact the
    least change may throw a motion elsewhere: a derivative is noise then, and would be taken
    for a reading that tells much. So derivatives count by how well those to both sides agree.
    `start_std`: (S,) what is unknown of a start, in terms of which it is derived by starts.
    `groups`: to be quicker, and a little wrong; one-sided where nothing can touch.
    """
    num_fitted, num_starts = len(loop.fitted), len(loop.start_tangents)
    is_quick = groups is not None
    groups = groups or Groups.one_by_one(num_fitted + num_starts, loop.num_readings)
    delta = np.full(num_fitted + num_starts, _STATE_DELTA)
    delta[:num_fitted] = np.where(unit[loop.fitted] > 0.5, -_UNIT_DELTA, _UNIT_DELTA)
    units, tangents = _changed(loop, unit, start_std, delta, groups)
    # Worlds in which a parameter is changed are looked at from the other side, too
    twice = np.unique(groups.number[:num_fitted])
    twice = twice[:0] if is_quick and not loop.may_touch else twice
    is_inside, more_units, more_tangents = _other_side(unit, units[twice], tangents[twice])
    units = np.concatenate([unit[None], units, more_units])
    tangents = np.concatenate([0 * tangents[:1], tangents, more_tangents])
    spread = np.repeat(tangents[:, None], len(states), 1)
    predicted, _ = loop.play(stretches, loop.physics.space.move(states, spread), units)
    here, there, beyond = np.split(predicted, [1, 1 + len(groups.owner)])
    changes = (there - here).swapaxes(0, 1)  # (W, G, K + 1, D)
    inward = is_inside[:, None, None, None]
    others = np.where(inward, here - beyond, beyond - there[twice]).swapaxes(0, 1)
    changes[:, twice] = agreed(changes[:, twice], others)
    is_owner = groups.owner[groups.number] == np.arange(len(delta))[:, None]  # (U, D)
    slopes = changes[:, groups.number] * is_owner[:, None] / delta[:, None, None]
    return Slopes(here[0], slopes[:, :num_fitted], slopes[:, num_fitted:])


def _changed(
    loop: OpenLoop, unit: np.ndarray, start_std: np.ndarray, delta: np.ndarray, groups: Groups
) -> tuple[np.ndarray, np.ndarray]:
    """(G, N) parameters and (G, 2 nv) tangents of starts, one group of unknowns changed in each."""
    num_groups, num_fitted = len(groups.owner), len(loop.fitted)
    units = np.repeat(unit[None], num_groups, 0)
    units[groups.number[:num_fitted], loop.fitted] += delta[:num_fitted]
    tangents = np.zeros((num_groups, loop.start_tangents.shape[1]))
    change = (delta[num_fitted:] * start_std)[:, None] * loop.start_tangents
    np.add.at(tangents, groups.number[num_fitted:], change)
    return units, tangents


def _other_side(
    unit: np.ndarray, units: np.ndarray, tangents: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a second difference ends that begins here; at a bound, one that begins there.

    (B,) bool whether it is the former; (B, N) parameters, (B, 2 nv) tangents.
    """
    back = 2 * unit - units
    is_inside = np.all((back >= 0) & (back <= 1), axis=1)
    side = np.where(is_inside, -1, 2)[:, None]
    return is_inside, unit + side * (units - unit), side * tangents
