"""Selects one of a few hypotheses by comparing their misfits window by window."""

import numpy as np

_CLEARLY = 0.05  # by how much −log likelihood per observation must be lower,
_SURELY = 1.5  # ... and by how many standard errors of that difference


def clearly_best(misfits: np.ndarray) -> int:
    """The row of (hypotheses, W) misfits that is clearly lowest; 0, the usual one, if none is.

    Misfits vary far more between windows than between hypotheses, so the differences in the same
    windows are compared (paired), not two medians.
    """
    worse = misfits - misfits[0]
    at_best = worse.mean(1) + _SURELY * worse.std(1) / np.sqrt(worse.shape[1])
    best = int(np.argmin(at_best))
    return best if at_best[best] < -_CLEARLY else 0
