"""What encoders show more than the truth: pictures say where joints really are.

A first, quick fit leans on what was detected in the pictures, since readings count as if they were
far noisier. What is left of them then, in the median, is their offset.
"""

from dataclasses import replace
from typing import TypeGuard

import numpy as np

from simtune.fit.observed import Observed
from simtune.fit.physics import Physics
from simtune.fit.shooting import ShootingFit
from simtune.observation import AllEvidence, JointReadings

_LOOSE = 300.0  # times the noise: an offset of a good part of that does not draw the fit


def has_unknown_offsets(observed: Observed) -> bool:
    """Whether there are any, and something else to find them by."""
    parts = observed.evidence.parts
    return any(map(_is_unknown, parts)) and not all(
        isinstance(part, JointReadings) for part in parts
    )


def loosened(observed: Observed) -> Observed:
    """With readings that count little."""
    parts = (
        replace(part, noise=_LOOSE * part.noise) if _is_unknown(part) else part
        for part in observed.evidence.parts
    )
    return replace(observed, evidence=AllEvidence(tuple(parts)))


def without_offsets(
    observed: Observed, physics: Physics, fit: ShootingFit, parameters: np.ndarray
) -> tuple[Observed, np.ndarray]:
    """The same without their offsets, and these, (D,) over all readings of joints.

    `fit`: of the `loosened` ones, in a world of (N,) parameters.
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
                left = part.values[at] - predicted[..., start:end]
                found = np.nan_to_num(np.nanmedian(left.reshape(-1, len(found)), 0))
            part = replace(part, values=part.values - found)
            offsets.append(found)
        parts.append(part)
        start = end
    return replace(observed, evidence=AllEvidence(tuple(parts))), np.concatenate(offsets)


def _is_unknown(part: object) -> TypeGuard[JointReadings]:
    return isinstance(part, JointReadings) and part.finds_offset
