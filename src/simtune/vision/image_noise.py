"""What a real camera does to pictures and no simulator draws."""

from dataclasses import dataclass

import numpy as np

from simtune.vision.smoothing import smoothed, with_smooth_chroma


@dataclass(frozen=True)
class ImageNoise:
    """What a real camera does to a picture and the simulator does not; other in each world.

    It is randomised, not tuned: the detector learns to look past it. The detector's errors, with
    which the posterior network is trained, grow by what it cannot look past. Of a fit's
    `CameraResponse` the gain, tint, offset and gamma are the prior.
    """

    gain: float = 0.06  # standard deviation of the logarithm of brightness
    tint: float = 0.02  # the same, for each channel by itself
    offset: float = 0.01  # of the full scale
    gamma: float = 0.05  # standard deviation of the logarithm of the exponent
    noise: float = 0.025  # at most, of the full scale

    def apply(self, frames: np.ndarray, rng: np.random.Generator) -> None:
        """Make (W, F, H, W, 3) uint8 as drawn, in place, what W cameras record of them."""
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
    """(F, H, W, 3) pictures mixed with themselves, as they are after `smooth`."""
    return (1 - share) * pictures + share * smooth(pictures)
