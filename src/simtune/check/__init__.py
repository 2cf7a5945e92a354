"""Before any training: does each parameter show, and are the recordings sound?"""

from simtune.check.check import check
from simtune.check.table import table

__all__ = ["check", "table"]
