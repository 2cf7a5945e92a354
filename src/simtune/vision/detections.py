"""What the keypoint detector finds in pictures."""

from typing import NamedTuple

import numpy as np


class Detections(NamedTuple):
    """Detections in n pictures."""

    keypoints: np.ndarray  # (n, L, 2) pixels
    candidates: np.ndarray  # (n, 2, L, 2) pixels: the same, and the second best place
    probability: np.ndarray  # (n, 2, L) of each place; the rest is for elsewhere
    spread: np.ndarray  # (n, 2, L, 2) pixels, of the heatmap around each place
    visible: np.ndarray  # (n, V) visible parameters, in coordinates of the whole space

    def episodes(self, num: int) -> list["Detections"]:
        """Split into `num` successive episodes of equal length."""
        parts = (np.split(values, num) for values in self)
        return [Detections(*fields) for fields in zip(*parts, strict=True)]

    def first(self, num: int) -> "Detections":
        """Those of the first `num` pictures."""
        return Detections(*(values[:num] for values in self))
