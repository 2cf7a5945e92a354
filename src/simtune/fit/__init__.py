"""Physics and pictures fitted to what sight saw: from the SPM's estimate to the last per cent."""

from simtune.fit.budget import affordable
from simtune.fit.conclusions import correlations, doubts, in_range, ranks, widened
from simtune.fit.fit import Fit, ReplayFit, Replicas, num_fitted
from simtune.fit.shooting import ShootingConfig, Stage

__all__ = [
    "Fit",
    "ReplayFit",
    "Replicas",
    "ShootingConfig",
    "Stage",
    "affordable",
    "correlations",
    "doubts",
    "in_range",
    "num_fitted",
    "ranks",
    "widened",
]
