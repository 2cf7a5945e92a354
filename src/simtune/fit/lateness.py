"""How late pictures or readings come, by less than a step: one more unknown of a fit.

A camera's exposure, a bus, drivers and the clocks of recordings add milliseconds that nobody
knows, and a few of them look like a softer servo. Whole steps are found before (`latency`); what is
left is fitted together with the parameters, so that they are no surer than it allows.
"""

from dataclasses import dataclass

import numpy as np

from simtune.observation import AllEvidence, JointReadings
from simtune.simulation import Simulator

_MOST_STEPS = 0.75  # later, or sooner
_PREDICTIONS_PER_STEP = 4  # where physics has as many: a wheel may turn far in a step


@dataclass(frozen=True)
class Lateness:
    """Which predictions, of D, come late all by the same time."""

    is_late: np.ndarray  # (D,) bool
    shares: np.ndarray  # (n + 1,) of a step at which it is predicted; its begin and end are two

    @classmethod
    def of_pictures(cls, evidence: AllEvidence, num_substeps: int) -> "Lateness":
        """Where the pictures of all cameras may come late, but no sensor's readings do.

        `num_substeps`: of physics in a step.
        """
        of_each = [np.full(len(p.scale), not isinstance(p, JointReadings)) for p in evidence.parts]
        return cls(np.concatenate(of_each), _shares(num_substeps))

    @classmethod
    def of_readings(cls, num_readings: int, num_substeps: int) -> "Lateness":
        """Where all of D readings may come late, after the actions that they answer."""
        return cls(np.ones(num_readings, bool), _shares(num_substeps))

    @property
    def predictions_per_step(self) -> int:
        return len(self.shares) - 1

    @staticmethod
    def steps(unit: np.ndarray) -> np.ndarray:
        """Of unit coordinates, as the unknown has them."""
        return (2 * unit - 1) * _MOST_STEPS

    @staticmethod
    def unit(steps: float) -> float:
        """The inverse of `steps`."""
        return (1 + steps / _MOST_STEPS) / 2

    @classmethod
    def found(cls, unit: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
        """Steps, and their standard deviation, of a fit's (1,) unknown; (0,): nothing is late."""
        if not len(unit):
            return 0.0, 0.0
        late, above = cls.steps(unit[0]), cls.steps(unit[0] + np.sqrt(covariance[0, 0]))
        return float(late), float(above - late)

    def seen(self, predicted: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(..., K, D) what is seen at K steps of what comes so late by (...) `unit`.

        `predicted`: (..., 1 + (K − 1) n, D), n of each step. Actions change at steps, so there the
        motion has kinks; within a step it is smooth. So y(t − d) is read off the parabola through
        the nearest predictions of the step that t − d lies in, or of the first or last one.
        """
        num = self.predictions_per_step
        seen = predicted[..., ::num, :].copy()
        last = seen.shape[-2] - 2
        if last < 0:
            return seen
        late, steps = self.steps(unit)[..., None, None], np.arange(last + 2)
        before = self._within(predicted, np.maximum(steps - 1, 0), late, np.arange(num + 1)[-3:])
        after = self._within(predicted, np.minimum(steps, last), late, np.arange(num + 1)[:3])
        is_before = ((late > 0) | (steps > last)[:, None]) & (steps > 0)[:, None]
        seen[..., self.is_late] = np.where(is_before, before, after)
        return seen

    def _within(
        self, predicted: np.ndarray, step: np.ndarray, late: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """(..., K, L) of what is late, each by those `points` of its `step`, (K,); by Neville."""
        its, shares = predicted[..., self.is_late], self.shares[points]
        since = (np.arange(len(step)) - step)[:, None] - late  # the step began
        values = [its[..., self.predictions_per_step * step + point, :] for point in points]
        for order in range(1, len(points)):
            ends = zip(shares, shares[order:], values, values[1:], strict=False)
            values = [
                ((since - right) * one - (since - left) * other) / (left - right)
                for left, right, one, other in ends
            ]
        return values[0]


def _shares(num_substeps: int) -> np.ndarray:
    num = min(_PREDICTIONS_PER_STEP, num_substeps)
    return np.linspace(0, num_substeps, num + 1).round() / num_substeps


def as_seen(simulator: Simulator, full_states: np.ndarray, late_steps: float) -> np.ndarray:
    """(..., K, S) full states of K steps as pictures show them that come so late.

    With velocities v, a step's change of them Δv, and its length h, positions are then nearly

        q(t − d) = q_t − d h v_t + ½ d² h Δv
    """
    if not late_steps or full_states.shape[-2] == 1:
        return full_states
    space = simulator.state_space
    states = space.positions_and_velocities(full_states)
    velocities = states[..., -space.nv :]
    changes = np.diff(velocities, axis=-2)
    at_end = changes[..., :1, :] if late_steps > 0 else changes[..., -1:, :]
    of_steps = [at_end, changes] if late_steps > 0 else [changes, at_end]
    behind = np.zeros((*states.shape[:-1], space.num_tangent))
    behind[..., : space.nv] = simulator.step_s * (
        late_steps**2 / 2 * np.concatenate(of_steps, -2) - late_steps * velocities
    )
    return space.with_positions_and_velocities(full_states, space.move(states, behind))
