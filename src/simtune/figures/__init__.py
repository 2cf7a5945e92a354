"""What many runs say together, from their folders alone: curves, ablations, tables."""

from simtune.figures.write import write_figures

__all__ = ["write_figures"]
