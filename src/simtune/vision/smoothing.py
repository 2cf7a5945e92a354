"""Smoothing of pictures: by lenses, and of chroma by videos."""

import numpy as np

LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # of R, G and B (ITU-R BT.601)


def smoothed(pictures: np.ndarray) -> np.ndarray:
    """(..., H, W, C) float pictures smoothed with weights 1, 2, 1 along either axis.

    In place of pixels beyond the edges are those at the edges.
    """
    for axis in (-3, -2):
        total = 2 * pictures
        pixels, sums = (np.moveaxis(array, axis, 0) for array in (pictures, total))
        sums[1:] += pixels[:-1]
        sums[:-1] += pixels[1:]
        sums[0] += pixels[0]
        sums[-1] += pixels[-1]
        total /= 4
        pictures = total
    return pictures


def with_smooth_chroma(pictures: np.ndarray, passes: int = 2) -> np.ndarray:
    """(..., H, W, 3) float pictures with smoothed chroma and unchanged luma.

    Videos store chroma at half the resolution (4:2:0), so things a few pixels wide look greyer. If
    smoothed by more than that, pictures look alike whether they went through a video or not.
    """
    luma = (pictures @ LUMA)[..., None]
    chroma = pictures - luma
    for _ in range(passes):
        chroma = smoothed(chroma)
    return luma + chroma
