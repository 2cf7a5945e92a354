"""The report of a run: one HTML file that works offline, made from the run folder only."""

from pathlib import Path

__all__ = ["write_report"]


def write_report(run_path: Path | str) -> Path:
    """See `page.write_report`; what draws is loaded then, not by who only reads runs."""
    from simtune.report import page

    return page.write_report(run_path)
