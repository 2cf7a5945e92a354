"""A descent on readings, and one Gauss-Newton step of it."""

from dataclasses import dataclass, replace

import numpy as np

from simtune.fit.readings.replay_objective import Guess, Point, ReplayObjective
from simtune.fit.readings.slopes import StretchSlopes

FIRST_DAMPING = 1e-2  # relative to the diagonal of the information
# Of all masses and forces together, readings tell some 1e-5 of what they tell of each alone: with
# more damping than that, a descent creeps, and ends beside the optimum.
_DAMPING = (1e-7, 1e6)
_MAX_TRIED_STEPS = 7  # each with more damping, before the descent ends
_MIN_GAIN_SHARE = 1e-4  # of the cost, by a step, for another one to follow


@dataclass(frozen=True)
class Descent:
    """Where Gauss-Newton is or ended, with the last derivatives."""

    objective: ReplayObjective
    point: Point
    noise: np.ndarray  # (D,) root mean square of the residuals
    slopes: StretchSlopes | None = None
    is_cut_off: bool = False  # whether time ended it

    @property
    def unit(self) -> np.ndarray:
        """(N,) parameters in unit coordinates; those not fitted are unchanged."""
        return self.point.unit

    @property
    def begun(self) -> np.ndarray:
        """(N,) where it began."""
        return self.objective.cut_at.unit

    @property
    def guess(self) -> Guess:
        """Start of another descent."""
        return Guess(self.point.unit, self.point.offsets)

    @property
    def log_rms(self) -> float:
        """Mean logarithm of the residuals' rms over all readings: lower is better."""
        known = np.isfinite(self.objective.stretches.values).sum((0, 1))
        return float(np.average(np.log(self.noise), weights=known))

    def with_actuator_states(self, left: np.ndarray) -> "Descent":
        """With other (W, S) states where stretches begin, as earlier actions left them."""
        stretches = self.objective.stretches._replace(actuator_states=left)
        return replace(self, objective=replace(self.objective, stretches=stretches))


def stepped(start: Descent, slopes: StretchSlopes, damping: float) -> tuple[Descent, float, bool]:
    """One Gauss-Newton step with derivatives at the start.

    Also the next damping, and whether the gain is too small to go on.
    """
    start = replace(start, slopes=slopes)
    objective, noise = start.objective, start.noise
    equations = objective.equations(start.point, slopes, noise)
    shared = objective.with_prior(equations, start.point)
    before = objective.cost(start.point, objective.residuals(start.point, slopes.predicted), noise)
    if equations.promised(*shared) < _MIN_GAIN_SHARE * before:
        return start, damping, True
    for _ in range(_MAX_TRIED_STEPS):
        point = objective.step(start.point, equations, damping)
        residuals = objective.residuals(point, objective.play(point)[0])
        gain = before - objective.cost(point, residuals, noise)
        damping = float(np.clip(damping * (0.2 if gain > 0 else 8), *_DAMPING))
        if gain > 0:
            is_over = gain < _MIN_GAIN_SHARE * before
            return replace(start, point=point, noise=objective.noise(residuals)), damping, is_over
    return start, damping, True
