"""Image noise on tensors: simulated pictures as real cameras would record them."""

from typing import NamedTuple

import torch

from simtune.vision.image_noise import ImageNoise


class NoisyCameras(NamedTuple):
    """What (n, C, 1, 1) cameras do to pictures; a single one films any number of them."""

    gain: torch.Tensor
    offset: torch.Tensor  # of the full scale
    noise: torch.Tensor
    blur: torch.Tensor
    generator: torch.Generator  # of the noise, which is other in each picture

    @classmethod
    def draw(cls, like: ImageNoise, num: int, generator: torch.Generator) -> "NoisyCameras":
        """As many cameras, each with a gain, tint, offset, blur and noise of its own."""

        def normal(channels: int) -> torch.Tensor:
            size = (num, channels, 1, 1)
            return torch.randn(size, generator=generator, device=generator.device)

        def uniform() -> torch.Tensor:
            return torch.rand(num, 1, 1, 1, generator=generator, device=generator.device)

        return cls(
            gain=(like.gain * normal(1) + like.tint * normal(3)).exp(),
            offset=like.offset * normal(1),
            noise=like.noise * uniform(),
            blur=uniform(),
            generator=generator,
        )

    def __call__(self, pictures: torch.Tensor) -> torch.Tensor:
        """(B, 3, H, W) in [−1, 1], as drawn, to the same as recorded; B = n, or n = 1."""
        smooth = pictures
        for axis in (2, 3):
            smooth = (smooth.roll(1, axis) + 2 * smooth + smooth.roll(-1, axis)) / 4
        drawn = (pictures.lerp(smooth, self.blur) + 1) / 2
        noise = torch.randn(drawn.shape, generator=self.generator, device=drawn.device)
        seen = drawn * self.gain + self.offset + self.noise * noise
        return seen.clamp(0, 1) * 2 - 1
