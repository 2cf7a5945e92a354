"""What a fit starts from, what it finds, and how well it fits."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class PointEstimate(NamedTuple):
    """Parameters as far as they are known before a fit."""

    parameters: np.ndarray  # (N,)
    std: np.ndarray  # (N,) in unit coordinates


@dataclass(frozen=True)
class Misfit:
    """How badly observations fit a simulator; larger is worse, NaN where it cannot be said."""

    motion: tuple[float, ...]  # of each sensor: its typical distance from the simulation, in units
    picture: float  # noise of a pixel, of the full scale


@dataclass(frozen=True)
class FitResult:
    """Parameters (N,) as fitted, with their standard deviations in unit coordinates."""

    parameters: np.ndarray
    std: np.ndarray  # (N,)
    # (N,) standard deviations of what is wrong with all data alike, and no fit can see
    discrepancy_std: np.ndarray
    correlation: np.ndarray  # (P, P) between the fitted parameters that are no mere appearance
    moving: np.ndarray  # (P,) which those are
    misfit: Misfit
    sensors: tuple[tuple[str, str], ...]  # names and units of the misfits in motion
    start: np.ndarray  # (S,) the full state in which the first episode began
    latency_steps: int  # by which the actions seem to take effect late

    @property
    def is_moving(self) -> np.ndarray:
        """(N,) bool."""
        return np.isin(np.arange(len(self.std)), self.moving)

    @property
    def claimed_std(self) -> np.ndarray:
        """(N,) of the fit and of what it cannot see, together."""
        return np.hypot(self.std, self.discrepancy_std)
