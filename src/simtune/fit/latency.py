"""Which of a few explanations is the right one, told by windows that are compared one by one."""

import numpy as np

_CLEARLY = 0.05  # by so much −log likelihood of an observation has to be lower to be believed,
_SURELY = 1.5  # ... and by so many standard errors of that


def clearly_best(misfits: np.ndarray) -> int:
    """The row of (explanations, W) misfits that is clearly lowest; 0, the usual one, if none is.

    How well a window can be explained differs far more from window to window than from one
    explanation to the other: so the same windows' differences count, and not two medians.
    """
    worse = misfits - misfits[0]
    at_best = worse.mean(1) + _SURELY * worse.std(1) / np.sqrt(worse.shape[1])
    best = int(np.argmin(at_best))
    return best if at_best[best] < -_CLEARLY else 0
