"""Errors that are common to all pictures of a film: unknowns of a fit, beside the parameters.

A detector that hardly sees a keypoint puts it where it usually is, in every picture alike, which
looks like a longer rope. So a fit has a constant error per prediction as an unknown with a small
prior (`Evidence.common_std`): it no longer biases parameters, and their covariance allows for it.
"""

from typing import NamedTuple

import numpy as np

from simtune.fit.combine import COMMON_STD
from simtune.observation import AllEvidence


class Beside(NamedTuple):
    """How far pictures of a camera show everything beside where it is simulated, all alike."""

    camera: str  # the name of its evidence
    stds: float  # root mean square of the common errors, in those that known worlds have
    px: float  # root mean square of their lengths
    right: float  # their mean, in pixels
    down: float


def directions(evidence: AllEvidence) -> np.ndarray:
    """(Q, D) derivatives of predictions by unknowns of prior standard deviation COMMON_STD."""
    std = evidence.common_std
    unknown = np.flatnonzero(std)
    by_unknown = np.zeros((len(unknown), len(std)))
    by_unknown[np.arange(len(unknown)), unknown] = std[unknown] / COMMON_STD
    return by_unknown


def beside(evidence: AllEvidence, common: np.ndarray) -> tuple[Beside, ...]:
    """Of each camera, from (Q,) common errors that a fit found."""
    std, found = evidence.common_std, common @ directions(evidence)
    ends = np.cumsum([len(part.scale) for part in evidence.parts])[:-1]
    its = zip(evidence.parts, np.split(std, ends), np.split(found, ends), strict=True)
    return tuple(_beside(part.name, std, found) for part, std, found in its if std.any())


def _beside(camera: str, std: np.ndarray, found: np.ndarray) -> Beside:
    """From (2 L,) errors of x and y in turn; `std`: of known worlds."""
    known = std > 0
    stds = np.sqrt(np.square(found[known] / std[known]).mean())
    weight = np.where(known, 1 / np.square(np.maximum(std, 1e-9)), 0.0).reshape(-1, 2)
    right, down = (weight * found.reshape(-1, 2)).sum(0) / np.maximum(weight.sum(0), 1e-9)
    px = np.sqrt(np.square(found.reshape(-1, 2)).sum(1).mean())
    return Beside(camera, float(stds), float(px), float(right), float(down))
