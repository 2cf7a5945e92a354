"""Open-loop replays as recordings begin: motors that lag may have been running before.

A robot that stood still had its motors off. A log that is cut out of a flight or a drive begins
with motors at work, and until their lag is over a replay in which they are off goes elsewhere.
"""

import numpy as np

from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.stretches import Readings
from simtune.observation import ObservationModel, assumed_noise
from simtune.simulation import AnySimulator, Simulator

_FIRST_S, _FEWEST_STEPS = 0.25, 4
_MOST_EPISODES = 8
_SIZES = (1 / 3, 1 / 2, 1.0, 2.0, 3.0)  # of what actions do: nobody knows their gains yet
_CLEARLY = 0.7


def recorded_loop(
    simulator: AnySimulator, observation: ObservationModel, start: np.ndarray, readings: Readings
) -> OpenLoopReplay:
    """`OpenLoopReplay.of`, with motors that ran before if first readings clearly say so."""
    loop = OpenLoopReplay.of(simulator, observation, start)
    assert isinstance(simulator, Simulator), "sensors measure a model's joints"
    if not simulator.held.motors_lag:
        return loop
    running = OpenLoopReplay.of(simulator.with_running_motors(), observation, start)
    unit = simulator.space.to_unit(start)
    off, ran = (_left(its, readings, unit) for its in (loop, running))
    return running if ran < _CLEARLY * off else loop


def _left(loop: OpenLoopReplay, readings: Readings, unit: np.ndarray) -> float:
    """Squared residuals of the first moments in units of the usual noise, at the best of `_SIZES`.

    In a world of (N,) parameters.
    """
    steps = max(_FEWEST_STEPS, round(_FIRST_S / loop.physics.simulator.step_s))
    few = Readings(
        readings.actions[:_MOST_EPISODES, :steps], readings.values[:_MOST_EPISODES, : steps + 1]
    )
    whole, noise = Segments.evenly(few), assumed_noise(loop.sensors)
    left = []
    for size in _SIZES:
        its = Readings(size * few.actions, few.values)
        stretches = loop.cut_at(its, unit, np.zeros(len(noise)), whole)
        played, _ = loop.play(stretches, stretches.states[None], unit[None])
        left.append(float(np.nansum(np.square((played[0] - stretches.values) / noise))))
    return min(left)
