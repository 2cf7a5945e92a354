"""What a fit starts from, what it finds, and how well it fits."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from simtune.fit.lateness import PICTURES
from simtune.fit.motion.common_errors import Beside
from simtune.fit.pictures.response import CameraResponse


class PointEstimate(NamedTuple):
    """Parameters as known before a fit."""

    parameters: np.ndarray  # (N,)
    std: np.ndarray  # (N,) in unit coordinates


@dataclass(frozen=True)
class Misfit:
    """How badly observations fit a simulator; larger is worse, NaN if unknown."""

    motion: tuple[float, ...]  # each sensor's typical distance from the simulation, in its unit
    # Noise of the pixels that show each visible parameter, of the full scale
    picture: tuple[float, ...]


@dataclass(frozen=True)
class FitResult:
    """Parameters (N,) as fitted, with their standard deviations in unit coordinates."""

    parameters: np.ndarray
    std: np.ndarray  # (N,)
    # (N,) standard deviations of errors common to all data, which no fit can detect
    discrepancy_std: np.ndarray
    # (N, N) of the fit's errors in unit coordinates; 0 between motion and pictures
    correlation: np.ndarray
    is_moving: np.ndarray  # (N,) bool: not mere appearance
    misfit: Misfit
    sensors: tuple[tuple[str, str], ...]  # name and unit of each motion misfit
    starts: np.ndarray  # (E, S) full states at the start of the episodes
    latency_steps: int  # estimated delay of the actions
    # (N,) standard deviations of the particles' estimate, the fit's start; 0 for appearance
    rough_std: np.ndarray
    offsets: np.ndarray  # (D,) measured − true, of joint readings beside pictures; may be empty
    known: np.ndarray  # (K,) indices of known parameters, which were not fitted
    responses: list[CameraResponse]  # one per camera; none if pictures are the simulator's own
    held_out: int | None = None  # the episode that only the misfit was computed from
    # {"pictures": (seconds by which they are also late, std)}, also of readings; empty: known
    late_s: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    is_too_late: bool = False  # whether one of these is the most that is fitted
    beside: tuple[Beside, ...] = ()  # of each camera
    unusual_camera: CameraResponse | None = None  # what known colours make of one
    # (K,) indices of held parameters, which stay where the fit began
    held: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    @property
    def pictures_late_s(self) -> tuple[float, float]:
        """With standard deviation; 0 if it is known."""
        return self.late_s.get(PICTURES, (0.0, 0.0))

    @property
    def unfitted(self) -> np.ndarray:
        """(K,) indices of known and held parameters."""
        return np.union1d(self.known, self.held).astype(int)

    @property
    def refitted_discrepancy_std(self) -> np.ndarray:
        """(N,) the part of the discrepancy that refits show: what cameras do to colours."""
        return np.where(self.is_moving, 0.0, self.discrepancy_std)


def block_correlation(count: int, blocks: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(N, N) correlation from covariances of blocks, 0 between blocks.

    `blocks`: indices (K,) and covariance (K, K) of each, 0 for known parameters.
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
    """(N, N) correlation of errors after independent errors are added.

    `share`: (N,) the old standard deviations over the new, σᵢ / √(σᵢ² + τᵢ²).
    """
    mixed = correlation * np.outer(share, share)
    np.fill_diagonal(mixed, 1)
    return mixed
