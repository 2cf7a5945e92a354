"""Figures of many runs, from their folders only: curves, ablations, tables."""

from simtune.figures.write import write_figures

__all__ = ["write_figures"]
