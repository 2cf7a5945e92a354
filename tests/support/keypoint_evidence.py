"""Keypoints as a detector would find them, for tests that have no pictures."""

import numpy as np

from simtune.fit import Observed
from simtune.observation import AllEvidence
from simtune.vision.keypoint_tracks import KeypointTracks


def tracks_at(
    points: np.ndarray, noise_px: float, image_size: int = 64, probability: float = 0.98
) -> KeypointTracks:
    """Of (E, T + 1, 2 L) pixels, where keypoints are detected for sure."""
    candidates = points.reshape(*points.shape[:2], 1, -1, 2).repeat(2, 2)
    probabilities = np.zeros(candidates.shape[:-1])
    probabilities[:, :, 0] = probability
    noise = np.full(candidates.shape[-2], noise_px)
    return KeypointTracks(candidates, probabilities, noise, (image_size, image_size))


def observed_keypoints(
    points: np.ndarray, actions: np.ndarray, noise_px: float, image_size: int = 64
) -> Observed:
    """Episodes of (E, T, A) actions in which nothing but keypoints is observed."""
    tracks = tracks_at(points, noise_px, image_size)
    return Observed(AllEvidence((tracks,)), actions.astype(float))
