"""How late pictures or readings come, by less than a step: one more unknown of a fit.

Camera exposure, buses, drivers and recording clocks add unknown milliseconds; a few of them look
like a softer servo. Whole steps are found before (`line_up`). The rest is fitted together with the
parameters, so that their uncertainty allows for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.observation import AllEvidence, JointReadings
from simtune.simulation import Simulator

PICTURES, READINGS = "pictures", "readings"
MOST_STEPS = 0.75  # largest lateness, either way
STEPS_PER_UNIT = 2 * MOST_STEPS  # derivative of `steps_late`
_END_STEPS = 0.05  # to the end of that range, where it is no longer free
_PREDICTIONS_PER_STEP = 4  # if there are as many substeps: a wheel may turn far in a step


@dataclass(frozen=True)
class Lateness:
    """Which of D predictions come late together: each of G kinds by a time of its own."""

    kind: np.ndarray  # (D,) index of `kinds`; −1: on time
    shares: np.ndarray  # (n + 1,) times of the predictions as shares of a step, with 0 and 1
    kinds: tuple[str, ...] = (PICTURES,)

    @classmethod
    def of_evidence(
        cls,
        evidence: AllEvidence,
        num_substeps: int,
        kinds: Sequence[str] = (PICTURES, READINGS),
    ) -> "Lateness":
        """All pictures may be late, by the same time, and all readings, by another.

        Actions that take effect late delay both, a camera only its pictures. `num_substeps`:
        physics substeps per step; `kinds`: what is not on time.
        """
        each = [READINGS if isinstance(p, JointReadings) else PICTURES for p in evidence.parts]
        late = tuple(kind for kind in kinds if kind in each)
        sizes = [len(part.scale) for part in evidence.parts]
        kind = np.repeat([late.index(name) if name in late else -1 for name in each], sizes)
        return cls(kind, _shares(num_substeps), late)

    @classmethod
    def of_readings(cls, num_readings: int, num_substeps: int) -> "Lateness":
        """All D readings may be late, relative to the actions."""
        return cls(np.zeros(num_readings, int), _shares(num_substeps), (READINGS,))

    def only(self, kind: str) -> "Lateness":
        """Of what is of one kind."""
        num = np.count_nonzero(self.kind == self.kinds.index(kind))
        return replace(self, kind=np.zeros(num, int), kinds=(kind,))

    @property
    def predictions_per_step(self) -> int:
        return len(self.shares) - 1

    def seen(self, predicted: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(..., K, D) observations at K steps when each kind is late by its (..., G) `unit`.

        `predicted`: (..., 1 + (K − 1) n, D), n per step. The motion has kinks at steps, where
        actions change, and is smooth between. So y(t − d) is interpolated by a parabola through the
        nearest predictions of the step that contains t − d (clamped to the first and last step).
        """
        num = self.predictions_per_step
        last = (predicted.shape[-2] - 1) // num - 1
        if last < 0:
            return predicted
        late, steps = steps_late(unit)[..., None, self.kind], np.arange(last + 2)  # (..., 1, D)
        before = self._within(predicted, np.maximum(steps - 1, 0), late, np.arange(num + 1)[-3:])
        after = self._within(predicted, np.minimum(steps, last), late, np.arange(num + 1)[:3])
        is_before = ((late > 0) | (steps > last)[:, None]) & (steps > 0)[:, None]
        is_late = self.kind >= 0
        return np.where(is_late, np.where(is_before, before, after), predicted[..., ::num, :])

    def _within(
        self, predicted: np.ndarray, step: np.ndarray, late: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """(..., K, D) predictions, interpolated from `points` of `step` (K,) (Neville)."""
        shares = self.shares[points]
        since = (np.arange(len(step)) - step)[:, None] - late  # since the step began
        values = [predicted[..., self.predictions_per_step * step + point, :] for point in points]
        for order in range(1, len(points)):
            ends = zip(shares, shares[order:], values, values[1:], strict=False)
            values = [
                ((since - right) * one - (since - left) * other) / (left - right)
                for left, right, one, other in ends
            ]
        return values[0]


def steps_late(unit: np.ndarray) -> np.ndarray:
    """Lateness in steps, from the unit coordinate in which it is fitted."""
    return (2 * unit - 1) * MOST_STEPS


def late_unit(steps: float) -> float:
    """The inverse of `steps_late`."""
    return (1 + steps / MOST_STEPS) / 2


def sooner_unit(unit: float, steps: int) -> float:
    """The unit coordinate of `steps` less, or of the least lateness."""
    return max(0.0, late_unit(float(steps_late(np.array(unit))) - steps))


def steps_late_and_std(unit: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """From a fit's (1,) unknown and its covariance; 0 if there is none."""
    if not len(unit):
        return 0.0, 0.0
    std = np.sqrt(max(0.0, covariance[0, 0]))  # rounding may leave less than nothing
    late, above = steps_late(unit[0]), steps_late(unit[0] + std)
    return float(late), float(above - late)


def is_too_late(late_steps: float) -> bool:
    """Whether a lateness ended at the end of its range, and hides the rest of a delay."""
    return abs(late_steps) > MOST_STEPS - _END_STEPS


def _shares(num_substeps: int) -> np.ndarray:
    num = min(_PREDICTIONS_PER_STEP, num_substeps)
    return np.linspace(0, num_substeps, num + 1).round() / num_substeps


def states_in_late_pictures(
    simulator: Simulator, full_states: np.ndarray, late_steps: float
) -> np.ndarray:
    """(..., K, S) full states of K steps as pictures show them that are late by `late_steps`.

    With velocities v, their change Δv in a step, and step length h, positions are approximately

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
