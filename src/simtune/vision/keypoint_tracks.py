"""Keypoints as evidence: where they were detected in episodes, and how likely that is.

What the detector says is a mixture: near the truth with the probability that it gives itself to
either of two places (what looks alike, left and right, gets mixed up), or else anywhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simtune.vision.detector import Detections

_SURE = 0.8
_SUREST = 0.99  # what a detector never saw in simulation it gives no chance at all; there is some
_ELSEWHERE = 0.003  # density of a keypoint that is at neither place, in units of the noise
_WIDE, _WIDE_SHARE = 4.0, 0.05  # the noise has wider tails than a normal distribution
_FEATURES_PER_IMAGE = 8  # positions, as features, go from −4 to 4 across the picture


@dataclass(frozen=True)
class KeypointTracks:
    """`Evidence` of L keypoints in (..., K) frames, each at one of two places or elsewhere."""

    candidates: np.ndarray  # (..., K, 2, L, 2) pixels, the more probable place first
    probability: np.ndarray  # (..., K, 2, L)
    noise_px: np.ndarray  # (L,) standard deviation where the detector is sure
    shape: tuple[int, int]  # (height, width) of pictures

    name, unit = "keypoints", "px"

    @classmethod
    def of_detections(
        cls,
        episodes: Sequence[Detections],
        shape: tuple[int, int],
        noise_px: np.ndarray | float = 1.0,
    ) -> "KeypointTracks":
        """From what was detected in E episodes of equal length."""
        candidates = np.stack([found.candidates for found in episodes])
        probability = _SUREST * np.stack([found.probability for found in episodes])
        noise = np.broadcast_to(noise_px, candidates.shape[-2:-1])
        return cls(candidates, probability, noise, shape)

    @property
    def scale(self) -> np.ndarray:
        return np.repeat(self.noise_px, 2)

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
        return replace(self, candidates=candidates, probability=probability)

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        """(...) Σ_K Σ_L log Σ_c p_c [N(r_c) + 0.05 N(r_c / 4)] + 0.003 (1 − Σ_c p_c)."""
        near, wide, elsewhere = self._densities(self._residuals(predicted, blur))
        return np.log((near + wide).sum(-2) + elsewhere).sum((-1, -2))

    def linearize(self, predicted: np.ndarray, blur: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """(..., K, 2 L) residuals to the candidate that explains best, and weights."""
        residuals = self._residuals(predicted, blur)  # (..., K, 2, L, 2)
        near, wide, elsewhere = self._densities(residuals)
        total = (near + wide).sum(-2) + elsewhere
        weight = (near + wide / _WIDE**2).max(-2) / total  # (..., K, L)
        best = (near + wide).argmax(-2)[..., None, :, None]
        nearest = np.take_along_axis(residuals, best, -3)[..., 0, :, :]
        flat = (*weight.shape[:-1], -1)
        return nearest.reshape(flat), np.repeat(weight[..., None], 2, -1).reshape(flat)

    def typical_distance(self, predicted: np.ndarray) -> float:
        nearest, _ = self.linearize(predicted)
        apart = nearest.reshape(*nearest.shape[:-1], -1, 2)
        distance = np.linalg.norm(apart, axis=-1) * self.noise_px  # (..., K, L)
        sure = self.probability.sum(-2) > 0.9
        return float(np.median(distance[sure])) if sure.any() else float("nan")

    def measured_noise_px(self, truth: np.ndarray) -> np.ndarray:
        """(L,) robust standard deviations of errors, where the detector is sure.

        `truth`: (..., K, L, 2) pixels where the keypoints really are. Errors are those of the
        better candidate: that it may be the other one is no noise.
        """
        errors, probability = self.candidates - truth[..., None, :, :], self.probability.sum(-2)
        better = np.square(errors).sum(-1).argmin(-2)[..., None, :, None]
        errors = np.abs(np.take_along_axis(errors, better, -3)[..., 0, :, :])  # (..., K, L, 2)
        noise = []
        for keypoint in range(len(self.noise_px)):
            known = probability[..., keypoint]
            sure = known >= min(_SURE, float(np.median(known)))
            noise.append(1.48 * np.median(errors[..., keypoint, :][sure]) + 0.05)
        return np.array(noise)

    def with_noise(self, noise_px: np.ndarray) -> "KeypointTracks":
        return replace(self, noise_px=noise_px)

    def _residuals(self, predicted: np.ndarray, blur: float) -> np.ndarray:
        """(..., K, 2, L, 2) from each candidate to (..., K, 2 L), in units of the noise."""
        points = predicted.reshape(*predicted.shape[:-1], 1, -1, 2)
        return (points - self.candidates) / (blur * self.noise_px)[:, None]

    def _densities(self, residuals: np.ndarray):
        """(..., K, 2, L) near and wide, (..., K, L) elsewhere: densities that add up."""
        square = np.minimum(np.square(residuals).sum(-1), 1e3)
        near = self.probability * np.exp(-0.5 * square)
        wide = self.probability * _WIDE_SHARE * np.exp(-0.5 * square / _WIDE**2)
        return near, wide, (1 - self.probability.sum(-2)) * _ELSEWHERE + 1e-12
