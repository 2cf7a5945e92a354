"""Detected keypoints of episodes as evidence, with their likelihood.

A detection is a mixture: near one of two places (similar things, left and right, get confused),
with the probabilities that the detector gives, or else anywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simtune.vision.detections import Detections
from simtune.vision.detector_bias import DetectorBias
from simtune.vision.detector_noise import DetectorNoise

_PROBABILITY_FACTOR = 0.99  # on the detector's: a rest for what it never saw in simulation
_ELSEWHERE_DENSITY = 0.003  # of a keypoint at neither place, in units of the noise
_WIDE_STD, _WIDE_SHARE = 4.0, 0.05  # wider component: tails are heavier than normal
_FEATURES_PER_IMAGE = 8  # scale of positions as features: −4 to 4 across the picture


@dataclass(frozen=True)
class KeypointTracks:
    """`Evidence` of L keypoints in (..., K) frames, each at one of two places or elsewhere."""

    candidates: np.ndarray  # (..., K, 2, L, 2) pixels, the more probable place first
    probability: np.ndarray  # (..., K, 2, L)
    noise_px: np.ndarray  # (L,) usual standard deviation
    shape: tuple[int, int]  # (height, width) of pictures
    # (..., K, 2, L, 2) information of each coordinate relative to the usual noise's; or 1
    information: np.ndarray | float = 1.0
    common_px: np.ndarray | float = 0.0  # (L, 2) std of a world's common error
    bias: DetectorBias | None = None  # what is added to true places where they are found

    name, unit = "keypoints", "px"

    @classmethod
    def of_detections(
        cls,
        episodes: Sequence[Detections],
        shape: tuple[int, int],
        noise: DetectorNoise,
    ) -> "KeypointTracks":
        """From the detections in E episodes of equal length, without the offset usual there."""
        candidates = np.stack([found.candidates for found in episodes]) - noise.offset_px
        probability = _PROBABILITY_FACTOR * np.stack([found.probability for found in episodes])
        own_px = noise(np.stack([found.spread for found in episodes]))
        information = np.square(noise.usual_px[:, None] / own_px)
        known = noise.usual_px, shape, information, noise.common_px, noise.bias
        return cls(candidates, probability, *known)

    @property
    def scale(self) -> np.ndarray:
        return np.repeat(self.noise_px, 2)

    @property
    def common_std(self) -> np.ndarray:
        return np.broadcast_to(self.common_px, (len(self.noise_px), 2)).ravel()

    @property
    def num_observations(self) -> int:
        return len(self.noise_px)

    @property
    def features(self) -> np.ndarray:
        """(..., K, 6 L) candidates and their probabilities."""
        half = _FEATURES_PER_IMAGE / 2
        places = self.candidates * _FEATURES_PER_IMAGE / self.shape[::-1] - half
        frames = self.probability.shape[:-2]
        return np.concatenate(
            [places.reshape(*frames, -1), self.probability.reshape(*frames, -1)], -1
        )

    def at(self, index: Any) -> "KeypointTracks":
        candidates, probability = self.candidates[index], self.probability[index]
        kept = self.information[index] if isinstance(self.information, np.ndarray) else 1.0
        return replace(self, candidates=candidates, probability=probability, information=kept)

    def only(self, kept: np.ndarray) -> "KeypointTracks":
        """Those `kept`, (L,) bool; the others count for nothing."""
        return replace(self, probability=np.where(kept, self.probability, 0.0))

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        """(...) Σ_K Σ_L log Σ_c p_c |i_c| [N(r_c) + 0.05 N(r_c / 4)] + 0.003 (1 − Σ_c p_c).

        r_c is in units of each coordinate's own noise, and |i_c| the factor of this on the density.
        """
        near, wide, elsewhere = self._densities(self._residuals(predicted, blur))
        return np.log((near + wide).sum(-2) + elsewhere).sum((-1, -2))

    def linearize(self, predicted: np.ndarray, blur: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """(..., K, 2 L) residuals to the candidate that explains best, and weights.

        Residuals are in units of the usual noise; weights include each one's relative information.
        """
        residuals = self._residuals(predicted, blur)  # (..., K, 2, L, 2)
        near, wide, elsewhere = self._densities(residuals)
        total = (near + wide).sum(-2) + elsewhere
        weight = (near + wide / _WIDE_STD**2).max(-2) / total  # (..., K, L)
        best = (near + wide).argmax(-2)[..., None, :, None]
        nearest = np.take_along_axis(residuals, best, -3)[..., 0, :, :]
        information = np.broadcast_to(self.information, residuals.shape)
        relative = np.take_along_axis(information, best, -3)[..., 0, :, :]
        flat = (*weight.shape[:-1], -1)
        return nearest.reshape(flat), (weight[..., None] * relative).reshape(flat)

    def typical_distance(self, predicted: np.ndarray) -> float:
        nearest, _ = self.linearize(predicted)
        apart = nearest.reshape(*nearest.shape[:-1], -1, 2)
        distance = np.linalg.norm(apart, axis=-1) * self.noise_px  # (..., K, L)
        sure = self.probability.sum(-2) > 0.9
        return float(np.median(distance[sure])) if sure.any() else float("nan")

    def _residuals(self, predicted: np.ndarray, blur: float) -> np.ndarray:
        """(..., K, 2, L, 2) from each candidate to (..., K, 2 L), in units of the noise."""
        # Slopes of predictions are taken without it: they differ by a percent.
        found = predicted if self.bias is None else predicted + self.bias(predicted)
        points = found.reshape(*found.shape[:-1], 1, -1, 2)
        return (points - self.candidates) / (blur * self.noise_px)[:, None]

    def _densities(self, residuals: np.ndarray):
        """(..., K, 2, L) near and wide, (..., K, L) elsewhere: densities to be summed."""
        square = np.minimum((self.information * np.square(residuals)).sum(-1), 1e3)
        of_both = np.broadcast_to(self.information, (*np.shape(self.information)[:-1], 2))
        density = self.probability * np.sqrt(of_both.prod(-1))
        near = density * np.exp(-0.5 * square)
        wide = density * _WIDE_SHARE * np.exp(-0.5 * square / _WIDE_STD**2)
        return near, wide, (1 - self.probability.sum(-2)) * _ELSEWHERE_DENSITY + 1e-12
