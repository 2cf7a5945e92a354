"""Grids of runs, carried out on this machine or on a Ray cluster; any process may be killed."""

from simtune.sweep.dry_run import dry_run
from simtune.sweep.sweep import sweep

__all__ = ["dry_run", "sweep"]
