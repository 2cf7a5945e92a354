"""What a real camera does to pictures and no simulator draws."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ImageNoise:
    """What a real camera does to a picture and the simulator does not; other in each world.

    It is randomised, not tuned: the detector learns to look past it. The detector's errors, with
    which the posterior network is trained, grow by what it cannot look past.
    """

    gain: float = 0.06  # standard deviation of the logarithm of brightness
    tint: float = 0.02  # the same, for each channel by itself
    offset: float = 0.02  # of the full scale
    noise: float = 0.025  # at most, of the full scale

    def apply(self, frames: np.ndarray, rng: np.random.Generator) -> None:
        """Make (W, F, H, W, 3) uint8 as drawn, in place, what W cameras record of them."""
        for drawn in frames:
            gain = np.exp(rng.normal(0, self.gain) + rng.normal(0, self.tint, 3))
            offset = 255 * rng.normal(0, self.offset)
            noise = 255 * rng.uniform(0, self.noise)
            seen = _blurred(drawn.astype(np.float32), rng.uniform(0, 1)) * gain.astype(np.float32)
            seen += offset + noise * rng.standard_normal(seen.shape, np.float32)
            drawn[:] = np.rint(seen).clip(0, 255)


def _blurred(pictures: np.ndarray, share: float) -> np.ndarray:
    """(F, H, W, 3) pictures mixed with themselves, smoothed over a pixel to each side."""
    smooth = pictures
    for axis in (1, 2):
        smooth = (np.roll(smooth, 1, axis) + 2 * smooth + np.roll(smooth, -1, axis)) / 4
    return (1 - share) * pictures + share * smooth
