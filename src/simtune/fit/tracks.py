"""What the detector saw of several episodes, and how sure it was."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simtune.trajectory import delayed
from simtune.vision.detector import Detections, KeypointDetector, detect

_SURE = 0.8
_SUREST = 0.99  # the detector gives what it never saw in simulation no chance at all; there is some


@dataclass(frozen=True)
class Tracks:
    """E episodes of T steps with L keypoints, each at one of two places or elsewhere."""

    places: np.ndarray  # (E, T + 1, 2, L, 2) pixels, the more probable one first
    probability: np.ndarray  # (E, T + 1, 2, L)
    actions: np.ndarray  # (E, T, A)

    def episodes(self, which) -> "Tracks":
        return Tracks(self.places[which], self.probability[which], self.actions[which])

    def delayed(self, steps: int) -> "Tracks":
        """The same, had the actions come so many steps later."""
        return Tracks(self.places, self.probability, delayed(self.actions, steps))


def track(detector: KeypointDetector, frames: Sequence[np.ndarray], actions: np.ndarray) -> Tracks:
    """What the detector makes of E times (T + 1, H, W, 3) frames; (E, T, A) actions go with them."""
    seen = [detect(detector, episode) for episode in frames]
    return to_tracks(Detections(*map(np.concatenate, zip(*seen, strict=True))), actions)


def to_tracks(seen: Detections, actions: np.ndarray) -> Tracks:
    """What the detector made of the frames of (E, T, A) actions' episodes, one after the other."""
    episodes = (len(actions), actions.shape[1] + 1)
    places = seen.places.reshape(*episodes, *seen.places.shape[1:])
    probability = _SUREST * seen.probability.reshape(*episodes, *seen.probability.shape[1:])
    return Tracks(places, probability, actions.astype(float))


def noise_px(tracks: Tracks, truth: np.ndarray) -> np.ndarray:
    """(L,) pixels: robust standard deviation of errors, where the detector is sure.

    `truth`: (E, T + 1, L, 2) where the keypoints really are.

    Of the better place: that it may be the other one is no noise.
    """
    errors, probability = tracks.places - truth[:, :, None], tracks.probability.sum(2)
    better = np.square(errors).sum(-1).argmin(2)[:, :, None, :, None]
    errors = np.abs(np.take_along_axis(errors, better, 2)[:, :, 0])  # (W, F, L, 2)
    noise = []
    for keypoint in range(errors.shape[2]):
        known = probability[..., keypoint]
        sure = known >= min(_SURE, float(np.median(known)))
        noise.append(1.48 * np.median(errors[:, :, keypoint][sure]) + 0.05)
    return np.array(noise)
