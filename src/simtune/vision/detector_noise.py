"""How far off a detector's keypoints are, measured where the truth is known.

A heatmap says how sure it is by how far it spreads: of a peg in a hole, or of an arm behind
another, it shows where it may be. So errors are told by the heatmap's spread, and each picture
counts as much as it tells.

Errors of one world are not independent, either. What a detector hardly sees it puts where that
usually is: in all pictures of a world too high, say. How large such common errors are is the
variance of worlds' mean errors, beyond what independent ones would leave (random effects).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from simtune.vision.detector import Detections

_SURE = 0.8  # probability of being at either of two places, from which errors are noise
_BINS, _FEWEST = 8, 40  # of spreads; pictures of each, at least
_LEAST_PX = 0.05
_FEWEST_OF_WORLD = 6  # pictures in which a world's keypoint is seen
_STD_OF_MEDIAN = 1.48  # over the median of normal errors' sizes


@dataclass(frozen=True)
class DetectorNoise:
    """Standard deviations of L keypoints' coordinates, which grow with the heatmaps' spread."""

    spread_px: np.ndarray  # (L, B) that rise
    std_px: np.ndarray  # (L, B) of errors, that do not fall
    common_px: np.ndarray  # (L, 2) of what a world's errors have in common

    @classmethod
    def measured(cls, episodes: Sequence[Detections], truth: np.ndarray) -> "DetectorNoise":
        """From detections in E episodes, where keypoints really are at (E, K, L, 2) pixels.

        Errors are those of the better candidate: that it may be the other one is no noise. They
        are compared robustly, over as many in each of B ranges of spreads, where the detector is
        sure that the keypoint is at either place.
        """
        candidates = np.stack([found.candidates for found in episodes])
        known = np.stack([found.probability for found in episodes]).sum(-2)  # (E, K, L)
        spread = np.stack([found.spread for found in episodes])
        errors = candidates - truth[..., None, :, :]  # (E, K, 2, L, 2)
        better = np.square(errors).sum(-1).argmin(-2)[..., None, :, None]
        errors = np.take_along_axis(errors, better, -3)[..., 0, :, :]  # (E, K, L, 2)
        spread = np.take_along_axis(spread, better, -3)[..., 0, :, :]
        sure = known >= np.minimum(_SURE, np.median(known, (0, 1)))
        common, errors = _common(np.where(sure[..., None], errors, np.nan)), np.abs(errors)
        bins = int(np.clip(sure.sum((0, 1)).min() // _FEWEST, 1, _BINS))
        curves = [
            _curve(spread[..., keypoint, :][its], errors[..., keypoint, :][its], bins)
            for keypoint, its in enumerate(np.moveaxis(sure, -1, 0))
        ]
        shape = (len(curves), bins)
        middles, stds = (np.reshape([curve[i] for curve in curves], shape) for i in (0, 1))
        return cls(middles, stds, common)

    @property
    def usual_px(self) -> np.ndarray:
        """(L,) in the middle of all pictures."""
        return self.std_px[:, self.std_px.shape[1] // 2]

    def __call__(self, spread: np.ndarray) -> np.ndarray:
        """(..., L, 2) standard deviations for heatmaps of (..., L, 2) spreads, pixels."""
        std = np.empty_like(spread)
        for keypoint, (middles, stds) in enumerate(zip(self.spread_px, self.std_px, strict=True)):
            std[..., keypoint, :] = np.interp(spread[..., keypoint, :], middles, stds)
        return std


def _common(errors: np.ndarray) -> np.ndarray:
    """(L, 2) standard deviation of what (E, K, L, 2) errors, NaN: unknown, have in common.

    Of worlds with medians m_w of n_w errors that vary by s_w²: the robust variance of m_w, less
    the π/2 · s_w² / n_w that the median of independent errors has.
    """
    count = np.isfinite(errors).sum(1)  # (E, L, 2)
    enough = (count >= _FEWEST_OF_WORLD).all(-1)  # (E, L)
    common = np.zeros(errors.shape[2:])
    for keypoint in np.flatnonzero(enough.any(0)):
        its = errors[enough[:, keypoint], :, keypoint]  # (e, K, 2)
        middles = np.nanmedian(its, 1)  # (e, 2)
        spread = _STD_OF_MEDIAN * np.nanmedian(np.abs(its - middles[:, None]), 1)
        chance = np.pi / 2 * np.square(spread) / count[enough[:, keypoint], keypoint]
        found = np.square(_STD_OF_MEDIAN * np.median(np.abs(middles), 0))
        common[keypoint] = np.sqrt(np.maximum(found - np.median(chance, 0), 0))
    return common


def _curve(spread: np.ndarray, errors: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """(B,) middles of ranges of (n, 2) spreads, and robust standard deviations of their errors."""
    order = np.argsort(spread, axis=None)
    parts = [np.array_split(its.ravel()[order], bins) for its in (spread, errors)]
    middles, stds = ([np.median(part) for part in its] for its in parts)
    return np.array(middles), isotonic_regression(_STD_OF_MEDIAN * np.array(stds) + _LEAST_PX).x
