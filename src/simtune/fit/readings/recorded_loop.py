"""Open-loop replays as recordings begin: motors that lag may have been running before.

A robot that stood still had its motors off. A log that is cut out of a flight or a drive begins
with motors at work, and until their lag is over a replay in which they are off goes elsewhere.
"""

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from simtune.budget import Budget
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.output_error import OutputErrorMethod, ReplayStage
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.replay_objective import Guess
from simtune.fit.readings.segments import FEWEST_STEPS
from simtune.observation import ObservationModel
from simtune.simulation import AnySimulator, Simulator

_FIRST_S = 0.25
_MOST_EPISODES = 8
_ITERATIONS = 20  # after ten, a lag five times too long is not found yet
# Of root mean square residuals. In worlds that began at rest, motors that ran left 1.7 times as
# much or more, if nothing came late; where flights were cut, .8 to 1.05 times as much
_MAX_RMS_RATIO = 0.9


def recorded_loop(
    simulator: AnySimulator, observation: ObservationModel, start: np.ndarray, readings: Readings
) -> OpenLoopReplay:
    """`set_up_loop`, with motors that ran before unless first readings clearly say otherwise.

    To call them running is safe: then fits leave out what depends on it (`unsettled_rows`). Not
    beside cameras, whose fits begin with motors off.
    """
    assert isinstance(simulator, Simulator), "sensors measure a model's joints"
    if not simulator.held.motors_lag or observation.cameras:
        return set_up_loop(simulator, observation, start)
    steps = max(FEWEST_STEPS, round(_FIRST_S / simulator.step_s))
    few = readings.first(steps, _MOST_EPISODES)
    ran = _ran_before(simulator, _First(observation, start, few))
    return set_up_loop(simulator.with_running_motors() if ran else simulator, observation, start)


class _First(NamedTuple):
    """First moments of episodes, and where a fit to them begins."""

    observation: ObservationModel
    start: np.ndarray  # (N,) parameters
    few: Readings

    def is_as(self, other: "_First") -> bool:
        """Whether these are the same; NaN is where nothing was read."""
        mine, others = ((its.start, its.few.actions, its.few.values) for its in (self, other))
        return self.observation is other.observation and all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(mine, others, strict=True)
        )


# A run asks again for its estimate of the time, its check, its fit and its last replay
_ANSWERS: WeakKeyDictionary[Simulator, list[tuple[_First, bool]]] = WeakKeyDictionary()


def _ran_before(simulator: Simulator, first: _First) -> bool:
    """Whether motors did, as far as these moments say."""
    answers = _ANSWERS.setdefault(simulator, [])
    for asked, ran in answers:
        if asked.is_as(first):
            return ran
    off, on = (_left(its, first) for its in (simulator, simulator.with_running_motors()))
    answers.append((first, ran := not off < on + np.log(_MAX_RMS_RATIO)))
    return ran


def _left(simulator: Simulator, first: _First) -> float:
    """Logarithm of what a fit to the first moments leaves.

    A fit, since lags and gains are not known yet: a slow start looks like a weak motor.
    """
    unit, no_offsets = simulator.space.to_unit(first.start), np.zeros(first.few.values.shape[-1])
    loop = set_up_loop(simulator, first.observation, first.start)
    method = OutputErrorMethod(loop, no_offsets > 0, unit)
    ended = method.descend(first.few, Guess(unit, no_offsets), ReplayStage(_ITERATIONS), Budget())
    return ended.log_rms
