"""Errors that are common to all pictures of a film: unknowns of a fit, beside the parameters.

A detector that hardly sees a keypoint puts it where it usually is, in every picture alike, which
looks like a longer rope. So a fit has a constant error per prediction as an unknown with a small
prior (`Evidence.common_std`): it no longer biases parameters, and their covariance allows for it.
"""

import numpy as np

from simtune.fit.combine import COMMON_STD
from simtune.observation import AllEvidence


def directions(evidence: AllEvidence) -> np.ndarray:
    """(Q, D) derivatives of predictions by unknowns of prior standard deviation COMMON_STD."""
    std = evidence.common_std
    unknown = np.flatnonzero(std)
    by_unknown = np.zeros((len(unknown), len(std)))
    by_unknown[np.arange(len(unknown)), unknown] = std[unknown] / COMMON_STD
    return by_unknown
