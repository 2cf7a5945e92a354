"""Tests whether runs agree."""

from simtune.compare.compare import compare
from simtune.compare.table import table

__all__ = ["compare", "table"]
