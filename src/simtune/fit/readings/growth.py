"""How far an episode can be followed open loop, before errors of its initial state grow.

Where a robot strikes something, the least change decides how it bounces, and a robot that topples
falls to either side. What follows tells nothing of the parameters, and a fit to it has a local
minimum for every other bounce. So an episode is followed for as long as errors grow little, and
again from there, with another initial state: multiple shooting, with segments as long as can be.
"""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from simtune.budget import NO_LIMIT, Budget
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.readings import Readings, filled
from simtune.fit.readings.segments import FEWEST_STEPS, ReadStates, Segments, Stretches, may_begin
from simtune.observation import assumed_noise

# Errors of a position that grow so many times are not followed: in servos and pendulums they grow
# 1 to 5 times, in episodes of robots that strike something or fall 70 to 50,000 times. Where an arm
# strikes a flap, fits leave the noise of the readings at 5 and 10, and twice as much at 30
MUCH = 10.0
_FOLLOWING = "looking how far episodes can be followed open loop: {:.0%}"
_GROWING = "asking how errors of first readings grow"
_REPORTED_EVERY_S = 5.0
_LOOKAHEAD_RATIO = 2  # to the longest segment so far, to look for the end of another one


def growth(
    loop: OpenLoopReplay, stretches: Stretches, unit: np.ndarray, budget: Budget = NO_LIMIT
) -> tuple[np.ndarray, float]:
    """(W, K + 1) how many times as large as at the start an error of a first position becomes.

    In any reading of a place; both relative to the usual noise, which is also the error's size: the
    least one would not say whether something is struck. `unit`: (N,) in unit coordinates. Also the
    share of the errors that there was time for.
    """
    erring = _erring(loop, stretches)
    predicted = _played(budget, _GROWING, loop, stretches, erring, unit)
    return _grown(loop, predicted), len(predicted) / len(erring)


def follow(
    loop: OpenLoopReplay, read: ReadStates, unit: np.ndarray, budget: Budget = NO_LIMIT
) -> tuple[Segments, float]:
    """Segments of worlds with (N,) parameters in unit coordinates: whole episodes, where possible.

    What cannot be followed for some steps is left out. If something may be pushed that no sensor
    measures, it has no steps: it leads to what comes after, with its errors. Later segments are at
    most twice as long as the longest before, so that the time that this takes is in proportion to
    an episode's. Left out is also what follows actions from before an episode.

    Also the share of the episodes that was looked at before the time was over.
    """
    next_begin = _next_begin(read.readings, assumed_noise(loop.sensors))
    if loop.measured.bases:
        read = loop.carried(read, unit, next_begin.shape[1] - 1)
    following = _Following(loop, read, unit, next_begin, budget)
    front, found = _Front(Segments.evenly(read.readings)), list[Segments]()
    whole, share = int(front.segments.steps.sum()), 0.0
    while len(front.segments.episode) and not (found and budget.is_over):
        erring, steps = following.looked_at(front, share)
        followed, front = following.advanced(front, erring, steps)
        found.append(followed)
        left = next_begin.shape[1] - 1 - front.segments.begin
        share = 1 - float(left.sum()) / max(1, whole)
    followed = Segments.joined(found)
    followed = followed if loop.measured.pushed.any() else followed.of(followed.steps > 0)
    return followed, share


class _Front(NamedTuple):
    """W segments that are looked at next, no longer than a number of steps."""

    segments: Segments
    longest: int = _LOOKAHEAD_RATIO * FEWEST_STEPS
    then: np.ndarray | None = None  # (G, W, nq + nv) states to which those before have led


@dataclass(frozen=True)
class _Following:
    """Of episodes as read, in worlds with (N,) parameters in unit coordinates."""

    loop: OpenLoopReplay
    read: ReadStates
    unit: np.ndarray
    next_begin: np.ndarray  # (E, T + 1)
    budget: Budget

    def looked_at(self, front: _Front, share: float) -> tuple[np.ndarray, np.ndarray]:
        """(G, W, nq + nv) initial states, and the (W,) steps before their errors grow much.

        `share`: of the episodes, looked at before.
        """
        stretches = self.read.cut(front.segments)
        erring = _erring(self.loop, stretches)
        if front.then is not None:
            erring = np.where(self.loop.measured.pushed, front.then, erring)
        budget = self.budget.part(self.budget.seconds, (share, 1.0))
        doing = _FOLLOWING.format(share)
        predicted = _played(budget, doing, self.loop, stretches, erring, self.unit)
        steps = _steps_followed(_grown(self.loop, predicted))
        return erring, np.minimum(steps, front.segments.steps)

    def advanced(
        self, front: _Front, erring: np.ndarray, steps: np.ndarray
    ) -> tuple[Segments, _Front]:
        """What of the segments is followed, without steps where that is little; what comes next."""
        left, last_row = front.segments, self.next_begin.shape[1] - 1
        settling = np.where(left.begin == 0, self.loop.unsettled_rows, 0)
        is_rest = (left.begin + steps == last_row) & (settling == 0)
        is_kept = (is_rest | (steps >= FEWEST_STEPS)) & (settling == 0)
        begin = left.begin + np.where(is_kept, steps, np.maximum(settling, FEWEST_STEPS))
        begin = self.next_begin[left.episode, np.minimum(begin, last_row)]
        goes_on = ~is_rest & (begin + FEWEST_STEPS <= last_row)
        then, longest = None, max(front.longest, _LOOKAHEAD_RATIO * int(steps.max()))
        if self.loop.measured.pushed.any() and goes_on.any():
            leading = left._replace(steps=begin - left.begin).of(goes_on)
            then = self._led(leading, erring[:, goes_on])
        rest = np.minimum(last_row - begin, longest)
        next_ones = Segments(left.episode, begin, rest).of(goes_on)
        followed = left._replace(steps=np.where(is_kept, steps, 0))
        return followed, _Front(next_ones, longest, then)

    def _led(self, leading: Segments, erring: np.ndarray) -> np.ndarray:
        """(G, W, nq + nv) states at the ends of segments that begin with `erring` ones."""
        units = self._units(erring)
        return self.loop.play_apart(self.read.cut(leading), erring, units, leading.steps)[2]

    def _units(self, erring: np.ndarray) -> np.ndarray:
        return np.repeat(self.unit[None], len(erring), 0)


def _erring(loop: OpenLoopReplay, stretches: Stretches) -> np.ndarray:
    """(G, W, nq + nv) initial states: as read, and with an error of each first position."""
    noise, measured = assumed_noise(loop.sensors), loop.measured
    # At usual noise, also where a segment begins between readings
    start_std = measured.start_std(noise, stretches._replace(begin=None))
    num = measured.num_places  # velocities follow
    errors = np.vstack([np.zeros(num), np.eye(num), -np.eye(num)])
    tangents = (errors * start_std[:num]) @ measured.start_tangents[:num]
    spread = np.repeat(tangents[:, None], len(stretches.states), 1)
    return loop.physics.space.move(stretches.states, spread)


def _played(
    budget: Budget,
    doing: str,
    loop: OpenLoopReplay,
    stretches: Stretches,
    states: np.ndarray,
    unit: np.ndarray,
) -> np.ndarray:
    """(G, W, K + 1, D) predictions from (G, W, nq + nv) states; of two at least, if time is over.

    Slow ones are played one after the other, and reported.
    """
    parts, began_s, num, size = list[np.ndarray](), time.monotonic(), 0, 1
    while num < len(states) and not (num > 1 and budget.is_over):
        budget.report(doing, num / len(states))
        some = states[num : num + size]
        parts.append(loop.play(stretches, some, np.repeat(unit[None], len(some), 0))[0])
        num += len(some)
        size = max(1, int(_REPORTED_EVERY_S * num / max(time.monotonic() - began_s, 1e-9)))
    return np.concatenate(parts)


def _grown(loop: OpenLoopReplay, predicted: np.ndarray) -> np.ndarray:
    """(W, K + 1) errors of (G, W, K + 1, D) predictions, of which the first is without an error.

    Speeds count only where no position is read: in their usual noise, an error of a position is
    large at once in whatever swings quickly.
    """
    counted = loop.measured.tells_places
    with np.errstate(over="ignore", invalid="ignore"):  # what flies away has grown much
        away = (predicted[1:] - predicted[0])[..., counted] / assumed_noise(loop.sensors)[counted]
    return np.abs(away).max((0, 3), initial=0.0)


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


def _steps_followed(grown: np.ndarray) -> np.ndarray:
    """(W,) steps before errors of the initial state have grown much; K if they never do."""
    has_grown = ~(grown <= MUCH)
    has_grown[:, 0] = False
    return np.where(has_grown.any(1), has_grown.argmax(1) - 1, has_grown.shape[1] - 1)
