"""Building blocks of pixel agents: heads on top of `PixelConvolutions`."""

import math

import torch
from torch import nn
from torch.nn import functional

from simtune.agents.half_copy import HalfCopy
from simtune.networks.layers import FineLinear, mlp
from simtune.networks.pixel_encoder import NUM_FEATURES, feature_head


class GaussianActor(nn.Module):
    """Flattened feature maps to the mean and log_std of actions before tanh."""

    def __init__(
        self, num_inputs: int, num_actions: int, hidden_size: int, log_std: tuple[float, float]
    ):
        super().__init__()
        self.log_std = log_std  # bounds
        self.head = feature_head(num_inputs)
        sizes = (NUM_FEATURES, hidden_size, hidden_size, 2 * num_actions)
        self.layers = mlp(sizes, nn.ReLU, last=FineLinear)

    def forward(self, maps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, F) to (B, A) each, float32."""
        mean, spread = self.layers(self.head(maps)).chunk(2, -1)
        return mean, bounded_log_std(spread, self.log_std)


def sample_squashed(
    mean: torch.Tensor, log_std: torch.Tensor, generator: torch.Generator | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """(B, A) means and log standard deviations to (B, A) actions and their (B,) log-densities.

    Actions are squashed into (−1, 1) by tanh (Haarnoja et al. 2018, app. C). Differentiable with
    respect to both.
    """
    noise = torch.randn(mean.shape, generator=generator, device=mean.device)
    before = mean + noise * log_std.exp()
    gaussian = -0.5 * noise.square() - log_std - 0.5 * math.log(2 * math.pi)
    # log(1 − tanh²), numerically stable for small values
    squeeze = 2 * (math.log(2) - before - functional.softplus(-2 * before))
    return before.tanh(), (gaussian - squeeze).sum(-1)


def bounded_log_std(spread: torch.Tensor, bounds: tuple[float, float]) -> torch.Tensor:
    """A network's output to log standard deviations within bounds, smoothly by tanh."""
    low, high = bounds
    return low + (high - low) / 2 * (spread.tanh() + 1)


class TwinQ(nn.Module):
    """Two Q functions, side by side."""

    def __init__(self, num_features: int, num_actions: int, hidden_size: int):
        super().__init__()
        sizes = (num_features + num_actions, hidden_size, hidden_size, 1)
        # Two networks: one batched product is no faster here, and copies their gradients.
        self.networks = nn.ModuleList(mlp(sizes, nn.ReLU, last=FineLinear) for _ in range(2))

    def forward(self, features: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """(B, F) and (B, A) to (2, B) float32."""
        both = torch.cat([features, actions.to(features.dtype)], -1)
        return torch.stack([q(both)[:, 0] for q in self.networks])


class Contrast(nn.Module):
    """CURL's classification: which of a batch's keys is of the same frames as this query?

    A bilinear product compares them (Laskin et al. 2020, Eq. 4 and appendix).
    """

    def __init__(self):
        super().__init__()
        self.weight = nn.Parameter(torch.rand(NUM_FEATURES, NUM_FEATURES))  # initialised as in CURL

    def forward(self, queries: torch.Tensor, keys: torch.Tensor) -> torch.Tensor:
        """(B, 50) each to logits (B, B): row i belongs to query i, whose own key is the i-th."""
        return queries @ (self.weight @ keys.T)

    def loss(self, queries: torch.Tensor, keys: torch.Tensor) -> torch.Tensor:
        """Mean cross-entropy."""
        own = torch.arange(len(queries), device=queries.device)
        return functional.cross_entropy(self(queries, keys), own)


def initialize(module: nn.Module) -> None:
    """Orthogonal matrices, and no biases: the initialisation of SAC-AE, as in CURL and RAD.

    A convolution starts as such a matrix in its centre (delta-orthogonal, Xiao et al. 2018).
    """
    gain = nn.init.calculate_gain("relu")
    for part in module.modules():
        if isinstance(part, nn.Linear):
            nn.init.orthogonal_(part.weight)
            nn.init.zeros_(part.bias)
        elif isinstance(part, nn.Conv2d):
            assert part.bias is not None
            nn.init.zeros_(part.weight)
            nn.init.orthogonal_(part.weight[:, :, 1, 1], gain)
            nn.init.zeros_(part.bias)


def descend(loss: torch.Tensor, optimizer: torch.optim.Optimizer, *copies: HalfCopy) -> None:
    """One step of an optimiser; other parameters of the loss get no gradient.

    `copies` are what the loss was computed by, in place of networks of the optimiser.
    """
    weights: list[torch.Tensor] = [p for group in optimizer.param_groups for p in group["params"]]
    halves = {w: used for half in copies for w, used in half.counterparts().items()}
    optimizer.zero_grad(set_to_none=True)
    loss.backward(inputs=[halves.get(weight, weight) for weight in weights])
    for half in copies:
        half.hand_over_gradients()
    optimizer.step()
    for half in copies:
        half.refresh()


def move_towards(target: nn.Module, online: nn.Module, share: float) -> None:
    """An exponential moving average: target ← (1 − share)·target + share·online."""
    with torch.no_grad():
        slow: list[torch.Tensor] = [*target.parameters()]
        fast: list[torch.Tensor] = [*online.parameters()]
        torch._foreach_lerp_(slow, fast, share)  # pyright: ignore[reportPrivateImportUsage]
