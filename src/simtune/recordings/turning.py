"""Commands of servos on endless joints, which may begin again after each turn as encoders do."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simtune.recordings.resample import counted_on

_SMALL_TURN, _NEARLY_A_TURN = 0.25, 0.75  # of a turn, from row to row


class Turning(NamedTuple):
    """An action that says where an endless joint shall be."""

    action: int  # its column
    period: float  # a turn, in the action's units
    reading: int | None = None  # column of the joint's readings; None: there are none
    scale: float = 1.0  # a reading is at the action `shift` + `scale` · reading
    shift: float = 0.0
    low: float = -np.inf  # what the servo takes at most: beyond, it would stop
    high: float = np.inf


def commands_counted_on(
    actions: np.ndarray, readings: np.ndarray, turnings: Sequence[Turning]
) -> np.ndarray:
    """(T, A) actions, those of `turnings` without jumps by a turn; (T, D) readings as recorded."""
    counted = actions.copy()
    for turning in turnings:
        commands, seen = actions[:, turning.action], np.full(len(actions), np.nan)
        if turning.reading is not None:
            period = np.array([turning.period / abs(turning.scale)])
            read = counted_on(readings[:, [turning.reading]], period)[:, 0]
            seen = turning.shift + turning.scale * read
        found = _counted_on(commands, seen, turning.period)
        if found.min() >= turning.low and found.max() <= turning.high:
            counted[:, turning.action] = found
    return counted


def _counted_on(commands: np.ndarray, seen: np.ndarray, period: float) -> np.ndarray:
    """(T,) commands without jumps, nearest to where (T,) readings saw the joint; NaN: unknown.

    As they are if that is nearer to the readings, since a servo may be sent farther than half a
    turn at once; without readings, unless all steps are either small or nearly a turn.
    """
    if not np.isfinite(commands).all() or np.ptp(commands) > 1.001 * period:
        return commands
    counted, known = np.unwrap(commands, period=period), np.isfinite(seen)
    if not known.any():
        steps = np.abs(np.diff(commands)) / period
        return counted if ((steps < _SMALL_TURN) | (steps > _NEARLY_A_TURN)).all() else commands
    counted -= period * np.rint(np.median((counted - seen)[known]) / period)
    off, counted_off = (np.abs(c - seen)[known].mean() for c in (commands, counted))
    # Farther off are readings in another unit, or of another joint
    return counted if counted_off < min(off, period / 2) else commands
