"""Open-loop replay of whole episodes, from initial states given by their first few readings."""

import numpy as np

from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.normal_equations import normal_equations
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.readings import Readings, unread_rows
from simtune.fit.readings.segments import Stretches
from simtune.observation import assumed_noise

_FIRST_STEPS = 5  # for the initial state
# Of Gauss-Newton, until it moves by less than this share of a standard deviation. From a jerk, as
# of a far command, it took eight; three left a joint 26 mrad off
_MOST_ITERATIONS, _SETTLED_STDS = 15, 0.1
_UNREAD_STD_FACTOR = 10.0  # added to the factor on its std, for each row that was not read
_MOST_UNREAD = 5  # rows before the first reading over which it is found all the same


def replay_whole(
    loop: OpenLoopReplay, readings: Readings, unit: np.ndarray, offsets: np.ndarray
) -> np.ndarray:
    """(E, T + 1, D) predictions of (N,) parameters in unit coordinates for whole episodes.

    The first few readings give the initial state; later ones are not used. `offsets`: (D,)
    measured − simulated.
    """
    whole, states = begin_whole(loop, readings, unit, offsets)
    return replay_from(loop, whole, states, unit, offsets)


def replay_from(
    loop: OpenLoopReplay,
    whole: Stretches,
    states: np.ndarray,
    unit: np.ndarray,
    offsets: np.ndarray,
) -> np.ndarray:
    """(E, T + 1, D) predictions from (E, nq + nv) initial states; see `replay_whole`."""
    predicted, _ = loop.play(whole, states[None], unit[None])
    return predicted[0] + offsets


def begin_whole(
    loop: OpenLoopReplay, readings: Readings, unit: np.ndarray, offsets: np.ndarray
) -> tuple[Stretches, np.ndarray]:
    """Whole episodes, and their (E, nq + nv) initial states.

    These explain the first few readings best (Gauss-Newton). Parameters are as in `replay_whole`.
    """
    whole = loop.cut(readings, unit, offsets)
    unread, states = unread_rows(whole.values), whole.states.copy()
    unread[unread > _MOST_UNREAD] = 0  # so much later, readings no longer tell
    loop = loop.by_starts_alone()
    for rows in np.unique(unread).tolist():
        alike = unread == rows
        states[alike] = _explaining(
            loop, whole.of(alike).first(_FIRST_STEPS + rows), unit, offsets, rows
        )
    return whole, states


def _explaining(
    loop: OpenLoopReplay, first: Stretches, unit: np.ndarray, offsets: np.ndarray, unread: int
) -> np.ndarray:
    """(W, nq + nv) initial states that explain the first steps best, of which some are `unread`."""
    noise, states = assumed_noise(loop.sensors), first.states
    start_std = loop.measured.start_std(noise, first) * (1 + _UNREAD_STD_FACTOR * unread)
    if not len(start_std):  # only velocities are read
        return states
    shift = np.zeros((len(states), len(start_std)))
    for _ in range(_MOST_ITERATIONS):
        slopes = differentiate(loop, DifferencePoint(first, states, unit, start_std))
        residuals = slopes.predicted + offsets - first.values
        equations = normal_equations(slopes.by_start, slopes.by_parameter, residuals, noise, shift)
        step = np.linalg.solve(equations.hessian, equations.gradient[..., None])[..., 0]
        shift = shift - step
        states = loop.measured.moved(first.states, shift, start_std)
        if np.abs(step).max() < _SETTLED_STDS:
            break
    return states
