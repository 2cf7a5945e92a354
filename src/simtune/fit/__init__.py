"""Physics and pictures fitted to what the detector saw: from the SPM's estimate to the last per cent."""

from simtune.fit.bootstrap import Bootstrap, run_bootstrap
from simtune.fit.particles import ParticleConfig
from simtune.fit.replay_fit import ReplayFit, num_fitted
from simtune.fit.result import FitResult
from simtune.fit.shooting import ShootingConfig, Stage
from simtune.fit.sizing import fit_to_budget
from simtune.fit.uncertainty import correlations, doubts, in_range, inflate, ranks

__all__ = [
    "Bootstrap",
    "FitResult",
    "ParticleConfig",
    "ReplayFit",
    "ShootingConfig",
    "Stage",
    "correlations",
    "doubts",
    "fit_to_budget",
    "in_range",
    "inflate",
    "num_fitted",
    "ranks",
    "run_bootstrap",
]
