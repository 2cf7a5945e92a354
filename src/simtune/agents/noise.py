"""Noise on actions, for exploration."""

import math

import torch


def disturbed(
    actions: torch.Tensor,
    std: float | torch.Tensor,
    generator: torch.Generator,
    clip: float = math.inf,
) -> torch.Tensor:
    """(B, A) actions with Gaussian noise within ±`clip`, in [−1, 1].

    Gradients ignore the clipping to [−1, 1] (Yarats et al. 2021, DrQ-v2).
    """
    noise = torch.randn(actions.shape, generator=generator, device=actions.device)
    noisy = actions + (noise * std).clamp(-clip, clip)
    return noisy + (noisy.clamp(-1, 1) - noisy).detach()


def uniform_actions(num: int, num_actions: int, generator: torch.Generator) -> torch.Tensor:
    """(num, A) random actions in [−1, 1]."""
    drawn = torch.rand(num, num_actions, generator=generator, device=generator.device)
    return 2 * drawn - 1


def falling(noise: tuple[float, float], done: float) -> float:
    """Standard deviation when a share `done`, in [0, 1], of the way from first to last is over."""
    first, last = noise
    return first + min(done, 1.0) * (last - first)
