"""Pictures smoothed: what lenses do to all of them, and videos to their colours."""

import numpy as np

LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # of R, G and B (ITU-R BT.601)


def smoothed(pictures: np.ndarray) -> np.ndarray:
    """(..., H, W, 3) pictures, each pixel with those to each side: 1, 2, 1 along either axis."""
    for axis in (-3, -2):
        pictures = (np.roll(pictures, 1, axis) + 2 * pictures + np.roll(pictures, -1, axis)) / 4
    return pictures


def with_smooth_chroma(pictures: np.ndarray, passes: int = 2) -> np.ndarray:
    """(..., H, W, 3) float pictures whose luma is as it was, and whose chroma is smoothed.

    Videos keep chroma at half the resolution (4:2:0), so what is a few pixels wide looks greyer.
    Smoothed by more than that, pictures that went through a video are as those that did not.
    """
    luma = (pictures @ LUMA)[..., None]
    chroma = pictures - luma
    for _ in range(passes):
        chroma = smoothed(chroma)
    return luma + chroma
