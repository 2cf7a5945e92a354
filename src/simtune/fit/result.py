"""What a fit starts from, what it finds, and how well it fits."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from simtune.fit.response import CameraResponse


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
    # (N, N) of the fit's errors in unit coordinates; 0 between what motion and what pictures tell
    correlation: np.ndarray
    moving: np.ndarray  # (P,) indices of the parameters that are no mere appearance
    misfit: Misfit
    sensors: tuple[tuple[str, str], ...]  # names and units of the misfits in motion
    start: np.ndarray  # (S,) the full state in which the first episode began
    latency_steps: int  # by which the actions seem to take effect late
    # (N,) standard deviations of the particles' estimate, where it began; 0 of mere appearance
    rough_std: np.ndarray
    offsets: np.ndarray  # (D,) measured − true, of joints that are read beside pictures; or none
    known: np.ndarray  # (K,) indices of the parameters that are known, and were not fitted
    responses: list[CameraResponse]  # of the cameras; none where pictures are the simulator's own
    held_out: int | None = None  # the episode that nothing was fitted to, but the misfit is of
    # (2,) seconds by which pictures come late besides, and how unsure that is; 0: it is known
    late_s: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @property
    def is_moving(self) -> np.ndarray:
        """(N,) bool."""
        return np.isin(np.arange(len(self.std)), self.moving)

    @property
    def claimed_std(self) -> np.ndarray:
        """(N,) of the fit and of what it cannot see, together."""
        return np.hypot(self.std, self.discrepancy_std)

    @property
    def claimed_correlation(self) -> np.ndarray:
        """(N, N) the same: of what it cannot see nothing is known, nor that any two go together."""
        return diluted(self.correlation, self.std / self.claimed_std)


def block_correlation(count: int, blocks: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(N, N) correlation where covariances are known in blocks, and 0 between these.

    `blocks`: of each, indices (K,) and the covariance (K, K), 0 of what is known.
    """
    correlation = np.eye(count)
    for at, covariance in blocks:
        deviation = np.sqrt(np.diag(covariance))
        is_known = deviation == 0
        deviation = np.where(is_known, 1, deviation)
        correlation[np.ix_(at, at)] = covariance / np.outer(deviation, deviation)
        correlation[at[is_known], at[is_known]] = 1
    return correlation


def diluted(correlation: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(N, N) correlation of errors to which others are added that are independent of each other.

    `share`: (N,) the old standard deviations over the new, σᵢ / √(σᵢ² + τᵢ²).
    """
    mixed = correlation * np.outer(share, share)
    np.fill_diagonal(mixed, 1)
    return mixed
