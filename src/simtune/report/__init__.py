"""The report of a run: one HTML file that works offline, made from the run folder only."""

from simtune.report.page import write_report

__all__ = ["write_report"]
