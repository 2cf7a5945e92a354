"""A sensor's measurements as a fit needs them: residuals, weights, likelihoods."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

import numpy as np


class Evidence(Protocol):
    """Measurements of one sensor, compared with a simulator's predictions of them.

    Arrays of measurements have leading axes (..., K): episodes or windows, and K frames.
    Predictions, (..., K, D), are the sensor's `observe` of simulated states; their leading axes
    broadcast against the measurements'. `blur` multiplies the noise: far from a solution, residuals
    are compared more coarsely.
    """

    @property
    def name(self) -> str:
        """For messages, such as "keypoints"."""
        ...

    @property
    def unit(self) -> str:
        """Unit of `typical_distance`."""
        ...

    @property
    def scale(self) -> np.ndarray:
        """(D,) standard deviations of the noise: the unit of residuals."""
        ...

    @property
    def common_std(self) -> np.ndarray:
        """(D,) standard deviations of a world's common errors, in units of predictions; 0: none."""
        ...

    @property
    def num_observations(self) -> int:
        """Independent observations per frame, over which likelihoods are averaged."""
        ...

    @property
    def features(self) -> np.ndarray:
        """(..., K, F) inputs for a network that guesses states, of size about 1; NaN: none."""
        ...

    def at(self, index: Any) -> Self:
        """The measurements at an index of the leading axes."""
        ...

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        """(...) of all K frames together, up to a constant."""
        ...

    def linearize(self, predicted: np.ndarray, blur: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """(..., K, D) residuals, predicted − measured in units of the noise, and their weights.

        Weights make the likelihood normal locally (iteratively reweighted least squares).
        """
        ...

    def typical_distance(self, predicted: np.ndarray) -> float:
        """Median distance, in `unit`, of predictions from certain measurements; or NaN."""
        ...


Part = TypeVar("Part", bound=Evidence)


@dataclass(frozen=True)
class AllEvidence:
    """The evidence of several sensors as one: predictions (..., K, D₁ + D₂ + …) side by side."""

    parts: tuple[Evidence, ...]

    @property
    def scale(self) -> np.ndarray:
        return np.concatenate([part.scale for part in self.parts])

    @property
    def common_std(self) -> np.ndarray:
        return np.concatenate([part.common_std for part in self.parts])

    @property
    def num_observations(self) -> int:
        return sum(part.num_observations for part in self.parts)

    @property
    def features(self) -> np.ndarray:
        return np.concatenate([part.features for part in self.parts], -1)

    def with_each(self, kind: type[Part], change: Callable[[Part], Evidence]) -> "AllEvidence":
        """With the parts of that kind changed."""
        return AllEvidence(
            tuple(change(part) if isinstance(part, kind) else part for part in self.parts)
        )

    def at(self, index: Any) -> "AllEvidence":
        return AllEvidence(tuple(part.at(index) for part in self.parts))

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        pairs = self._split(predicted)
        return np.sum([part.log_likelihood(columns, blur) for part, columns in pairs], axis=0)

    def linearize(self, predicted: np.ndarray, blur: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        both = (part.linearize(columns, blur) for part, columns in self._split(predicted))
        residuals, weights = zip(*both, strict=True)
        return np.concatenate(residuals, -1), np.concatenate(weights, -1)

    def distances(self, predicted: np.ndarray) -> tuple[float, ...]:
        """Each sensor's typical distance."""
        return tuple(part.typical_distance(columns) for part, columns in self._split(predicted))

    def _split(self, predicted: np.ndarray) -> Iterator[tuple[Evidence, np.ndarray]]:
        """Each sensor with its columns of (..., D) predictions."""
        ends = np.cumsum([len(part.scale) for part in self.parts])
        return zip(self.parts, np.split(predicted, ends[:-1], axis=-1), strict=True)
