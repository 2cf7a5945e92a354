"""Open-loop replays as recordings begin: motors that lag may have been running before.

A robot that stood still had its motors off. A log that is cut out of a flight or a drive begins
with motors at work, and until their lag is over a replay in which they are off goes elsewhere.
"""

import numpy as np

from simtune.budget import Budget
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.output_error import OutputErrorMethod, ReplayStage
from simtune.fit.readings.replay_objective import Guess
from simtune.fit.readings.segments import FEWEST_STEPS
from simtune.fit.readings.stretches import Readings
from simtune.observation import ObservationModel
from simtune.simulation import AnySimulator, Simulator

_FIRST_S = 0.25
_MOST_EPISODES = 8
_ITERATIONS = 20  # after ten, a lag five times too long is not found yet
# Of root mean square residuals. In worlds that began at rest, motors that ran left 1.7 times as
# much or more, if nothing came late; where flights were cut, .8 to 1.05 times as much
_CLEARLY = 0.9


def recorded_loop(
    simulator: AnySimulator, observation: ObservationModel, start: np.ndarray, readings: Readings
) -> OpenLoopReplay:
    """`set_up_loop`, with motors that ran before unless first readings clearly say otherwise.

    To call them running is safe: then fits leave out what depends on it (`unsettled_rows`). Not
    beside cameras, whose fits begin with motors off.
    """
    loop = set_up_loop(simulator, observation, start)
    assert isinstance(simulator, Simulator), "sensors measure a model's joints"
    if not simulator.held.motors_lag or observation.cameras:
        return loop
    running = set_up_loop(simulator.with_running_motors(), observation, start)
    unit = simulator.space.to_unit(start)
    off, ran = (_left(its, readings, unit) for its in (loop, running))
    return loop if off < ran + np.log(_CLEARLY) else running


def _left(loop: OpenLoopReplay, readings: Readings, unit: np.ndarray) -> float:
    """Logarithm of what a fit to the first moments leaves, from (N,) parameters.

    A fit, since lags and gains are not known yet: a slow start looks like a weak motor.
    """
    steps = max(FEWEST_STEPS, round(_FIRST_S / loop.physics.simulator.step_s))
    few = Readings(
        readings.actions[:_MOST_EPISODES, :steps], readings.values[:_MOST_EPISODES, : steps + 1]
    )
    no_offsets = np.zeros(few.values.shape[-1])
    method = OutputErrorMethod(loop, no_offsets > 0, unit)
    ended = method.descend(few, Guess(unit, no_offsets), ReplayStage(_ITERATIONS), Budget())
    return ended.log_rms
