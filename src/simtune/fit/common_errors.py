"""What all errors of a film have in common: unknowns of a fit, beside its parameters.

A detector puts what it hardly sees where that usually is, in every picture of a film alike. That
looks like a longer rope. As constants that are unknown, yet small (`Evidence.common_std`), such
errors no longer pass for the parameters, and these are no surer than the errors allow.
"""

import numpy as np

from simtune.fit.combine import COMMON_STD
from simtune.observation import AllEvidence


def directions(evidence: AllEvidence) -> np.ndarray:
    """(Q, D) by what predictions change with each unknown, of standard deviation COMMON_STD."""
    std = evidence.common_std
    unknown = np.flatnonzero(std)
    found = np.zeros((len(unknown), len(std)))
    found[np.arange(len(unknown)), unknown] = std[unknown] / COMMON_STD
    return found
