"""Evidence of joint readings: Student's t noise, with gaps."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

_DOF = 4.0  # of Student's t: heavy tails keep a lost packet from outweighing the others


@dataclass(frozen=True)
class JointReadings:
    """An `observation.Evidence`; NaN: no reading."""

    name: str
    unit: str
    values: np.ndarray  # (..., K, D)
    noise: float | np.ndarray  # of all, or (D,)
    middle: np.ndarray  # (D,) mean and std, which scale a network's inputs to about 1
    spread: np.ndarray
    finds_offset: bool = False  # whether a constant offset is unknown
    is_of_action: bool = False  # whether the action before each frame, not only its state, tells

    @classmethod
    def of(
        cls,
        name: str,
        unit: str,
        values: np.ndarray,
        noise: float | np.ndarray,
        finds_offset: bool = False,
        is_of_action: bool = False,
    ) -> "JointReadings":
        flat = values.reshape(-1, values.shape[-1])
        is_read = np.isfinite(flat).any(0)
        known = np.where(is_read, flat, 0.0)  # where nothing was ever read, any mean will do
        middle, spread = np.nanmean(known, 0), np.nanstd(known, 0)
        spread = np.maximum(spread, noise)
        return cls(name, unit, values, noise, middle, spread, finds_offset, is_of_action)

    @property
    def scale(self) -> np.ndarray:
        """(D,)"""
        return np.full(self.values.shape[-1], self.noise)

    @property
    def common_std(self) -> np.ndarray:
        """(D,) 0: an encoder's offset is known or found separately."""
        return np.zeros(self.values.shape[-1])

    @property
    def num_observations(self) -> int:
        return self.values.shape[-1]

    @property
    def features(self) -> np.ndarray:
        return (self.values - self.middle) / self.spread

    def scaled_as(self, other: "JointReadings") -> "JointReadings":
        """The same, with features on the scale of another's, on which a network was trained."""
        return replace(self, middle=other.middle, spread=other.spread)

    def at(self, index: Any) -> "JointReadings":
        return replace(self, values=self.values[index])

    def of_windows(self) -> "JointReadings":
        """As windows (..., K, D) see them, whose first frames no action of theirs leads to."""
        if not self.is_of_action:
            return self
        values = self.values.copy()
        values[..., 0, :] = np.nan
        return replace(self, values=values)

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        """(...) −(ν + 1) / 2 · log(1 + z² / ν), summed over all readings."""
        square = np.square(self._residuals(predicted, blur))
        return -(_DOF + 1) / 2 * np.log1p(np.nan_to_num(square) / _DOF).sum((-1, -2))

    def linearize(self, predicted: np.ndarray, blur: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Weights (ν + 1) / (ν + z²), 0 where nothing was read."""
        residuals = self._residuals(predicted, blur)
        known, residuals = np.isfinite(residuals), np.nan_to_num(residuals)
        return residuals, known * (_DOF + 1) / (_DOF + np.square(residuals))

    def typical_distance(self, predicted: np.ndarray) -> float:
        distance = np.abs(predicted - self.values)
        return float(np.nanmedian(distance)) if np.isfinite(distance).any() else float("nan")

    def _residuals(self, predicted: np.ndarray, blur: float) -> np.ndarray:
        return (predicted - self.values) / (blur * self.noise)
