"""Checks before any training: does each parameter show, and are the recordings sound?"""

from simtune.checking.check import carry_out, check
from simtune.checking.table import table

__all__ = ["carry_out", "check", "table"]
