"""Physics and pictures fitted to what sight saw: from the SPM's estimate to the last per cent."""

from simtune.fit.budget import affordable
from simtune.fit.conclusions import correlations, doubts, in_range, ranks, widened
from simtune.fit.fit import ReplayFit, num_fitted
from simtune.fit.found import Fit
from simtune.fit.particles import ParticleConfig
from simtune.fit.replicas import Replicas, make_replicas
from simtune.fit.shooting import ShootingConfig, Stage

__all__ = [
    "Fit",
    "ParticleConfig",
    "ReplayFit",
    "Replicas",
    "ShootingConfig",
    "Stage",
    "affordable",
    "correlations",
    "doubts",
    "in_range",
    "make_replicas",
    "num_fitted",
    "ranks",
    "widened",
]
