"""Errors of a detector's keypoints, measured where the truth is known.

A heatmap's spread shows its uncertainty: for a peg in a hole, or an arm behind another, it covers
all possible places. So errors are predicted from the spread, and each picture counts by its own
noise.

The errors of one world are correlated, too: the detector puts what it hardly sees where it usually
is, for example too high in all pictures. Worlds' errors have a mean, which is known and taken off,
as is how they depend on where things are (`DetectorBias`); the size of what then is common to a
world is the variance of worlds' mean errors in excess of what independent errors would give (random
effects).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from simtune.normal import MAD_TO_STD
from simtune.vision.detections import Detections
from simtune.vision.detector_bias import DetectorBias

_SURE_PROBABILITY = 0.8  # of both places together, from which errors are taken as noise
_MAX_BINS, _MIN_BIN_PICTURES = 8, 40  # of spreads; in each
_LEAST_PX = 0.05
_MIN_WORLD_PICTURES = 6  # in which a world's keypoint is seen
_MIN_WORLDS = 4  # whose mean error is taken off
_FAR_STDS = 2.0  # of a common error, from which a mean error is another one


@dataclass(frozen=True)
class DetectorNoise:
    """Standard deviations of L keypoints' coordinates as functions of the heatmaps' spread."""

    spread_px: np.ndarray  # (L, B) ascending
    std_px: np.ndarray  # (L, B) of errors, non-decreasing
    offset_px: np.ndarray  # (L, 2) mean of worlds' common errors, detected − true
    common_px: np.ndarray  # (L, 2) std of a world's common error around it
    bias: DetectorBias | None = None  # by which errors depend on places, around the offset

    @classmethod
    def measured(cls, episodes: Sequence[Detections], truth: np.ndarray) -> "DetectorNoise":
        """From detections in E episodes with true keypoints at (E, K, L, 2) pixels.

        The error is that of the better candidate: confusing the two is not noise. Robust standard
        deviations are taken in B bins of spread with equally many pictures, among those where the
        detector is sure that the keypoint is at either place.
        """
        candidates = np.stack([found.candidates for found in episodes])
        known = np.stack([found.probability for found in episodes]).sum(-2)  # (E, K, L)
        spread = np.stack([found.spread for found in episodes])
        errors = candidates - truth[..., None, :, :]  # (E, K, 2, L, 2)
        better = np.square(errors).sum(-1).argmin(-2)[..., None, :, None]
        errors = np.take_along_axis(errors, better, -3)[..., 0, :, :]  # (E, K, L, 2)
        spread = np.take_along_axis(spread, better, -3)[..., 0, :, :]
        sure = known >= np.minimum(_SURE_PROBABILITY, np.median(known, (0, 1)))
        bias = DetectorBias.measured(truth, np.where(sure[..., None], errors, np.nan))
        errors = errors - bias(truth.reshape(*truth.shape[:2], -1)).reshape(truth.shape)
        offset, common = _common(np.where(sure[..., None], errors, np.nan))
        sizes = np.abs(errors - offset)
        bins = int(np.clip(sure.sum((0, 1)).min() // _MIN_BIN_PICTURES, 1, _MAX_BINS))
        curves = [
            _curve(spread[..., keypoint, :][is_sure], sizes[..., keypoint, :][is_sure], bins)
            for keypoint, is_sure in enumerate(np.moveaxis(sure, -1, 0))
        ]
        shape = (len(curves), bins)
        middles, stds = (np.reshape([curve[i] for curve in curves], shape) for i in (0, 1))
        return cls(middles, stds, offset, common, bias)

    def is_off(self, other: "DetectorNoise") -> bool:
        """Whether a keypoint's mean error is farther from `other`'s than `other` allows for."""
        allowed = np.hypot(other.common_px, _LEAST_PX)
        return bool((np.abs(self.offset_px - other.offset_px) > _FAR_STDS * allowed).any())

    @property
    def usual_px(self) -> np.ndarray:
        """(L,) of a picture with median spread."""
        return self.std_px[:, self.std_px.shape[1] // 2]

    def __call__(self, spread: np.ndarray) -> np.ndarray:
        """(..., L, 2) standard deviations for heatmaps of (..., L, 2) spreads, pixels."""
        std = np.empty_like(spread)
        for keypoint, (middles, stds) in enumerate(zip(self.spread_px, self.std_px, strict=True)):
            std[..., keypoint, :] = np.interp(spread[..., keypoint, :], middles, stds)
        return std


def _common(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(L, 2) mean and standard deviation of worlds' common errors in (E, K, L, 2), NaN: unknown.

    With worlds' medians m_w of n_w errors with variance s_w²: the median of m_w, and the root of
    their robust variance around it minus π/2 · s_w² / n_w, the variance of the median of
    independent errors.
    """
    count = np.isfinite(errors).sum(1)  # (E, L, 2)
    enough = (count >= _MIN_WORLD_PICTURES).all(-1)  # (E, L)
    offset, common = np.zeros(errors.shape[2:]), np.zeros(errors.shape[2:])
    for keypoint in np.flatnonzero(enough.any(0)):
        of_keypoint = errors[enough[:, keypoint], :, keypoint]  # (e, K, 2)
        middles = np.nanmedian(of_keypoint, 1)  # (e, 2)
        spread = MAD_TO_STD * np.nanmedian(np.abs(of_keypoint - middles[:, None]), 1)
        chance = np.pi / 2 * np.square(spread) / count[enough[:, keypoint], keypoint]
        if len(middles) >= _MIN_WORLDS:
            offset[keypoint] = np.median(middles, 0)
        found = np.square(MAD_TO_STD * np.median(np.abs(middles - offset[keypoint]), 0))
        common[keypoint] = np.sqrt(np.maximum(found - np.median(chance, 0), 0))
    return offset, common


def _curve(spread: np.ndarray, errors: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """(B,) middles of ranges of (n, 2) spreads, and robust standard deviations of their errors."""
    order = np.argsort(spread, axis=None)
    parts = [np.array_split(values.ravel()[order], bins) for values in (spread, errors)]
    middles, stds = ([np.median(part) for part in values] for values in parts)
    return np.array(middles), isotonic_regression(MAD_TO_STD * np.array(stds) + _LEAST_PX).x
