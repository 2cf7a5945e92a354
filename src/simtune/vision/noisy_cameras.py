"""Image noise on tensors: simulated pictures as real cameras would record them."""

from typing import NamedTuple

import torch
import torch.nn.functional as F

from simtune.vision.image_noise import ImageNoise
from simtune.vision.smoothing import LUMA


class NoisyCameras(NamedTuple):
    """Parameters (n, C, 1, 1) of n cameras; a single one films any number of pictures."""

    gamma: torch.Tensor
    gain: torch.Tensor
    offset: torch.Tensor  # of the full scale
    noise: torch.Tensor
    blur: torch.Tensor
    blur_of_chroma: torch.Tensor  # see `with_smooth_chroma`
    generator: torch.Generator  # of the noise, independent between pictures

    @classmethod
    def draw(cls, like: ImageNoise, num: int, generator: torch.Generator) -> "NoisyCameras":
        """`num` cameras, each with its own gamma, gain, tint, offset, blur and noise."""

        def normal(channels: int) -> torch.Tensor:
            size = (num, channels, 1, 1)
            return torch.randn(size, generator=generator, device=generator.device)

        def uniform() -> torch.Tensor:
            return torch.rand(num, 1, 1, 1, generator=generator, device=generator.device)

        return cls(
            gamma=(like.gamma * normal(1)).exp(),
            gain=(like.gain * normal(1) + like.tint * normal(3)).exp(),
            offset=like.offset * normal(1),
            noise=like.noise * uniform(),
            blur=uniform(),
            blur_of_chroma=uniform(),
            generator=generator,
        )

    def __call__(self, pictures: torch.Tensor) -> torch.Tensor:
        """(B, 3, H, W) in [−1, 1], as drawn, to the same as recorded; B = n, or n = 1."""
        levels = ((pictures + 1) / 2) ** self.gamma
        drawn = levels.lerp(_smoothed(levels), self.blur)
        luma = _luma(drawn)
        chroma = drawn - luma
        drawn = luma + chroma.lerp(_smoothed(_smoothed(chroma)), self.blur_of_chroma)
        noise = torch.randn(drawn.shape, generator=self.generator, device=drawn.device)
        seen = drawn * self.gain + self.offset + self.noise * noise
        return seen.clamp(0, 1) * 2 - 1


def _smoothed(pictures: torch.Tensor) -> torch.Tensor:
    """(B, C, H, W) smoothed with weights 1, 2, 1 along either axis, as `smoothing.smoothed`."""
    wide, channels = F.pad(pictures, (1, 1, 1, 1), "replicate"), pictures.shape[1]
    weights = pictures.new_tensor([1, 2, 1]) / 4
    kernel = (weights[:, None] * weights).expand(channels, 1, 3, 3)
    return F.conv2d(wide, kernel, groups=channels)  # five times faster than sums of slices


def _luma(pictures: torch.Tensor) -> torch.Tensor:
    """(B, 3, H, W) to the same shape: in each channel the luma; faster than sums of channels."""
    # Filled where they are: a GPU would wait for a tensor from the host.
    shares = [pictures.new_full((3, 1, 1, 1), share) for share in LUMA.tolist()]
    return F.conv2d(pictures, torch.cat(shares, 1))
