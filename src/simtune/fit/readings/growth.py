"""How far an episode can be followed open loop, before errors of its initial state grow.

Where a robot strikes something, the least change decides how it bounces, and a robot that topples
falls to either side. What follows tells nothing of the parameters, and a fit to it has a local
minimum for every other bounce. So an episode is followed for as long as errors grow little, and
again from there, with another initial state: multiple shooting, with segments as long as can be.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.read_states import ReadStates
from simtune.fit.readings.segments import FEWEST_STEPS, Segments, may_begin
from simtune.fit.readings.stretches import Readings, Stretches, filled
from simtune.observation import assumed_noise

# Errors of a position that grow so many times are not followed: in servos and pendulums they grow
# 1 to 5 times, in episodes of robots that strike something or fall 70 to 50,000 times. Where an arm
# strikes a flap, fits leave the noise of the readings at 5 and 10, and twice as much at 30
MUCH = 10.0
_MOST = 16  # segments of an episode


def growth(loop: OpenLoopReplay, stretches: Stretches, unit: np.ndarray) -> np.ndarray:
    """(W, K + 1) how many times as large as at the start an error of a first position becomes.

    In any reading; both relative to the usual noise, which is also the size of the error: the least
    one would not say whether something is struck. `unit`: (N,) in unit coordinates.
    """
    noise, measured = assumed_noise(loop.sensors), loop.measured
    start_std = measured.start_std(noise, stretches.values)
    num = len(start_std) // 2  # velocities follow
    errors = np.vstack([np.zeros(num), np.eye(num), -np.eye(num)])
    tangents = (errors * start_std[:num]) @ measured.start_tangents[:num]
    spread = np.repeat(tangents[:, None], len(stretches.states), 1)
    units = np.repeat(unit[None], len(errors), 0)
    predicted, _ = loop.play(stretches, loop.physics.space.move(stretches.states, spread), units)
    return np.abs((predicted[1:] - predicted[0]) / noise).max((0, 3), initial=0.0)


def follow(loop: OpenLoopReplay, read: ReadStates, unit: np.ndarray) -> Segments:
    """Segments of worlds with (N,) parameters in unit coordinates: whole episodes, where possible.

    What cannot be followed for some steps is left out, unless that is all.
    """
    readings = read.readings
    last_row = readings.values.shape[1] - 1
    next_begin = _next_begin(readings, assumed_noise(loop.sensors))
    left, found = Segments.evenly(readings), list[Segments]()
    for _ in range(_MOST):
        steps = _steps_followed(loop, read.cut(left), unit)
        is_rest = steps >= left.steps
        is_kept = is_rest | (steps >= FEWEST_STEPS)
        found.append(left._replace(steps=np.minimum(steps, left.steps)).of(is_kept))
        begin = left.begin + np.where(is_kept, steps, FEWEST_STEPS)
        begin = next_begin[left.episode, np.minimum(begin, last_row)]
        is_left = ~is_rest & (begin + FEWEST_STEPS <= last_row)
        left = Segments(left.episode, begin, last_row - begin).of(is_left)
        if not len(left.episode):
            break
    followed = Segments.joined(found)
    return followed if len(followed.episode) else Segments.evenly(readings)


def _next_begin(readings: Readings, noise: np.ndarray) -> np.ndarray:
    """(E, T + 1) where a segment begins best, of the next rows with readings; T + 1: nowhere.

    There accelerations change least: during an impact, readings do not tell a velocity.
    """
    values = filled(readings.values) / noise
    jerk = np.abs(np.diff(values, 3, axis=1, append=np.repeat(values[:, -1:], 3, 1))).max(-1)
    jerk = np.maximum(np.roll(jerk, 1, 1), np.roll(jerk, 2, 1))  # of two rows before to two after
    num_rows = jerk.shape[1]
    jerk = np.pad(np.where(may_begin(readings), jerk, np.inf), ((0, 0), (0, FEWEST_STEPS)))
    jerk[:, num_rows:] = np.inf
    ahead = sliding_window_view(jerk, FEWEST_STEPS, 1)[:, :num_rows]  # (E, T + 1, 8)
    best = np.arange(num_rows) + ahead.argmin(-1)
    return np.where(np.isfinite(ahead.min(-1)), best, num_rows)


def _steps_followed(loop: OpenLoopReplay, stretches: Stretches, unit: np.ndarray) -> np.ndarray:
    """(W,) steps before errors of the initial state have grown much; K if they never do."""
    has_grown = ~(growth(loop, stretches, unit) <= MUCH)
    has_grown[:, 0] = False
    return np.where(has_grown.any(1), has_grown.argmax(1) - 1, has_grown.shape[1] - 1)
