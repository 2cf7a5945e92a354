"""Constant offsets of encoders, found from pictures, which show where joints really are.

A first, quick fit relies on detections in the pictures, since readings count as if far noisier. The
median residual of the readings is then their offset.
"""

from dataclasses import replace
from typing import TypeGuard

import numpy as np

from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.observation import AllEvidence, JointReadings

_LOOSE_NOISE_FACTOR = 300.0  # offsets then hardly bias the fit


def has_unknown_offsets(observed: Observed) -> bool:
    """Whether any offset is unknown, and there is other evidence to find it by."""
    parts = observed.evidence.parts
    return any(map(_is_unknown, parts)) and not all(
        isinstance(part, JointReadings) for part in parts
    )


def loosened(observed: Observed) -> Observed:
    """Observations whose readings with unknown offsets count little."""

    def loosen(part: JointReadings) -> JointReadings:
        return replace(part, noise=_LOOSE_NOISE_FACTOR * part.noise) if _is_unknown(part) else part

    return replace(observed, evidence=observed.evidence.with_each(JointReadings, loosen))


def without_offsets(
    observed: Observed, physics: Physics, fit: ShootingFit, parameters: np.ndarray
) -> tuple[Observed, np.ndarray]:
    """Observations with offsets subtracted, and the offsets, (D,) over all joint readings.

    `fit`: of the `loosened` observations, in a world of (N,) parameters.
    """
    full_states = fit.full_states  # (W, K, S)
    at = fit.episode[:, None], fit.step[:, None] + np.arange(full_states.shape[1])
    states = physics.states(full_states).reshape(-1, len(physics.some_state))
    predicted = physics.predict(states, physics.parameters.to_unit(parameters))
    predicted = predicted.reshape(*full_states.shape[:2], -1)
    parts, offsets, start = [], [], 0
    for part in observed.evidence.parts:
        end = start + len(part.scale)
        if isinstance(part, JointReadings):
            found = np.zeros(len(part.scale))
            if part.finds_offset:
                residuals = (part.values[at] - predicted[..., start:end]).reshape(-1, len(found))
                is_read = np.isfinite(residuals).any(0)
                found[is_read] = np.nanmedian(residuals[:, is_read], 0)
            part = replace(part, values=part.values - found)
            offsets.append(found)
        parts.append(part)
        start = end
    return replace(observed, evidence=AllEvidence(tuple(parts))), np.concatenate(offsets)


def _is_unknown(part: object) -> TypeGuard[JointReadings]:
    return isinstance(part, JointReadings) and part.finds_offset
