"""Actions of a Gaussian policy squashed into (−1, 1) by tanh (Haarnoja et al. 2018, app. C)."""

import math

import torch
from torch.nn import functional


def sample_squashed(
    mean: torch.Tensor, log_std: torch.Tensor, generator: torch.Generator | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """(B, A) means and log standard deviations to (B, A) actions and their (B,) log-densities.

    Differentiable with respect to both.
    """
    noise = torch.randn(mean.shape, generator=generator, device=mean.device)
    before = mean + noise * log_std.exp()
    gaussian = -0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)
    # log(1 − tanh²) in a form that does not lose small numbers
    squeeze = 2 * (math.log(2) - before - functional.softplus(-2 * before))
    return before.tanh(), (gaussian - squeeze).sum(-1)


def bounded_log_std(spread: torch.Tensor, bounds: tuple[float, float]) -> torch.Tensor:
    """A network's output to log standard deviations within bounds, as smoothly as tanh."""
    low, high = bounds
    return low + (high - low) / 2 * (spread.tanh() + 1)
