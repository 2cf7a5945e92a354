"""Effects of real cameras on pictures that simulators do not draw."""

from dataclasses import dataclass

import numpy as np

from simtune.vision.smoothing import smoothed, with_smooth_chroma


@dataclass(frozen=True)
class ImageNoise:
    """Effects of a real camera on a picture; drawn anew in each simulated world.

    They are randomised, not tuned: the detector learns to ignore them, and its measured errors,
    with which the posterior network is trained, include what it cannot ignore. Gain, tint, offset
    and gamma are also the prior of a fit's `CameraResponse`.
    """

    gain: float = 0.06  # standard deviation of the logarithm of brightness
    tint: float = 0.02  # the same, independent for each channel
    offset: float = 0.01  # of the full scale
    gamma: float = 0.05  # standard deviation of the logarithm of the exponent
    noise: float = 0.025  # upper bound, of the full scale

    def apply(self, frames: np.ndarray, rng: np.random.Generator) -> None:
        """Apply W random cameras to (W, F, H, W, 3) uint8 drawn frames, in place."""
        for drawn in frames:
            gain = np.exp(rng.normal(0, self.gain) + rng.normal(0, self.tint, 3))
            offset = 255 * rng.normal(0, self.offset)
            noise = 255 * rng.uniform(0, self.noise)
            levels = 255 * np.linspace(0, 1, 256) ** np.exp(rng.normal(0, self.gamma))
            seen = _mixed(smoothed, levels.astype(np.float32)[drawn], rng.uniform())
            seen = _mixed(with_smooth_chroma, seen, rng.uniform()) * gain.astype(np.float32)
            seen += offset + noise * rng.standard_normal(seen.shape, np.float32)
            drawn[:] = np.rint(seen).clip(0, 255)


def _mixed(smooth, pictures: np.ndarray, share: float) -> np.ndarray:
    """(F, H, W, 3) weighted mean of pictures and their smoothed version."""
    return (1 - share) * pictures + share * smooth(pictures)
