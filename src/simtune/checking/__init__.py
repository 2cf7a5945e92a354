"""Checks before any training: does each parameter show, and are the recordings sound?"""

from simtune.checking.check import check
from simtune.checking.command import carry_out
from simtune.checking.table import table

__all__ = ["carry_out", "check", "table"]
