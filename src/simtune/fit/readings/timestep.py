"""How much of an estimate makes up for the physics timestep.

A simulator's motion depends on its timestep, a robot's does not: a joint whose servo is integrated
in steps of 2 ms swings as if it were damped otherwise, and a fit that knows no better finds another
damping. Fitted with half the timestep, readings of a quadruped's servos gave dampings 5 and 8 %
lower and armatures 3 to 6 % higher, at intervals of ± 4 %.
"""

from dataclasses import replace

import mujoco
import numpy as np

from simtune.budget import Budget
from simtune.fit.readings.descent import Descent, stepped
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.slopes import StretchSlopes

# Change without any timestep, relative to that with half of it: errors are in proportion to the
# timestep (Euler, implicit), or to its fourth power (Runge-Kutta)
_NO_TIMESTEP_FACTOR, _NO_TIMESTEP_RK4 = 2.0, 16 / 15
_ITERATIONS = 6
# It begins at an optimum: also along what readings hardly tell, steps may be whole ones
_FIRST_DAMPING = 1e-6


def change_by_timestep(ended: Descent, slopes: StretchSlopes, budget: Budget) -> np.ndarray:
    """(P,) change of the estimate, in unit coordinates, if physics had no timestep.

    A descent that goes on with half the timestep, and with the derivatives `slopes` where it
    `ended`, changes the estimate by half as much, as errors are in proportion to the timestep. One
    that had not ended would go on anyway: so what as many steps with the whole timestep change is
    subtracted. Without time for more, one step each says most. 0 where simulated readings have the
    same timestep, or if actuators remember controls.
    """
    loop = ended.objective.loop
    finer = None if loop.is_simulated else loop.finer()
    if finer is None:
        return np.zeros(len(loop.fitted))
    both = [_Further(ended, each) for each in (finer, loop)]
    for number in range(_ITERATIONS):
        if number and budget.is_over:
            break
        for further in both:
            further.step(slopes)
    there, here = (further.descent.unit for further in both)
    is_rk4 = loop.physics.simulator.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4.value
    return (_NO_TIMESTEP_RK4 if is_rk4 else _NO_TIMESTEP_FACTOR) * (there - here)[loop.fitted]


class _Further:
    """A descent that goes on in another replay, with the same derivatives."""

    def __init__(self, ended: Descent, loop: OpenLoopReplay):
        self.descent = replace(ended, objective=replace(ended.objective, loop=loop))
        self._damping, self._is_over = _FIRST_DAMPING, False

    def step(self, slopes: StretchSlopes) -> None:
        if not self._is_over:
            predicted, _ = self.descent.objective.play(self.descent.point)
            here = slopes._replace(predicted=predicted)
            self.descent, self._damping, self._is_over = stepped(self.descent, here, self._damping)
