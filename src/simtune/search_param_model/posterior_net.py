"""The posterior network: from keypoints and actions of episodes to P(truth > candidate)."""

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional as F

from simtune.networks.layers import mlp

SHORTEST_STEPS = 21  # needed by the convolutions over time
_FIRST_LOG_SCALE, _SMALLEST_SCALE = -1.5, 1e-3  # of the mixture's logistics
_CANDIDATE_BOUNDS = (-1.0, 2.0)  # in coordinates of the range
_MIN_PROBABILITY = 1e-5  # distance from 0 and 1


@dataclass(frozen=True, kw_only=True)
class PosteriorNetConfig:
    channels: int = 64
    hidden: int = 128
    components: int = 3
    batch_size: int = 32
    learning_rate: float = 4e-3
    weight_decay: float = 1e-2
    candidates: int = 64  # of each kind, per world of a batch
    shortest_crop: int = 40  # steps
    crop_lengths: int = 8  # different ones


class PosteriorNet(nn.Module):
    """Maps the set of a world's episodes to one survival curve per parameter.

    Features of a world's episodes are pooled inside the network, which is trained on such sets.
    (Multiplying the curves of single episodes would count the prior once for each.) A curve is a
    mixture of logistics, so it is monotone by construction. Coordinates are those of the range
    searched: 0 at its low end, 1 at its high end.
    """

    most_episodes: torch.Tensor  # () largest number per world in training
    visible: torch.Tensor  # (V,) indices of the parameters that the detector estimates

    def __init__(
        self, num_inputs: int, visible: list[int], num_parameters: int, config: PosteriorNetConfig
    ):
        super().__init__()
        c, self.components = config.channels, config.components
        self.num_parameters = num_parameters
        indices = torch.tensor(visible, dtype=torch.long)
        self.register_buffer("visible", indices, persistent=False)
        self.first = nn.Conv1d(num_inputs, c, 5, stride=2)  # half the work, no accuracy lost
        self.later = nn.ModuleList([nn.Conv1d(c, c, 5) for _ in range(2)])
        num_pooled, num_out = 2 * c + 2 + len(visible), 3 * self.components * num_parameters
        self.head = mlp((num_pooled, config.hidden, config.hidden, num_out), nn.ELU)
        self.register_buffer("most_episodes", torch.tensor(1))
        spread = torch.linspace(-0.5, 0.5, self.components)
        self.register_buffer("spread", spread, persistent=False)

    def forward(self, motion: torch.Tensor, visible: torch.Tensor) -> "SurvivalMixture":
        """(B, E, T, S) keypoints and actions, (B, V) pooled visible estimates, to B × N curves."""
        worlds, episodes, steps, _ = motion.shape
        centred = 2 * visible - 1
        x = F.elu(self.first(motion.reshape(worlds * episodes, steps, -1).transpose(1, 2)))
        for conv in self.later:
            x = F.elu(conv(x)) + x[..., 2:-2]
        pooled = torch.cat([x.mean(-1), (x.square().mean(-1) + 1e-6).sqrt()], -1)
        pooled = pooled.view(worlds, episodes, -1).mean(1)
        # The curves' width depends on how much data the means are from. For more episodes than in
        # training, the largest number there is used: curves are too wide, if anything.
        number = self.most_episodes.to(pooled.dtype).clamp(max=episodes)
        amount = torch.stack([number, torch.full_like(number, steps / SHORTEST_STEPS)])
        amount = amount.log().expand(worlds, -1)
        out = self.head(torch.cat([pooled, amount, centred], -1))
        weights, offsets, scales = out.view(worlds, self.num_parameters, 3, -1).unbind(2)
        known = torch.zeros_like(offsets[..., :1])
        known = known.index_copy(1, self.visible, centred[..., None])
        # Only corrections have to be learnt; -1 is the range's low end, 1 its high end.
        locations = offsets + known + self.spread
        scales = (scales + _FIRST_LOG_SCALE).exp() + _SMALLEST_SCALE
        return SurvivalMixture(weights.log_softmax(-1), (locations + 1) / 2, scales / 2)


@dataclass(frozen=True)
class SurvivalMixture:
    """Mixtures of logistics: P(truth > candidate) for B worlds and N parameters."""

    log_weights: torch.Tensor  # (B, N, K)
    locations: torch.Tensor  # (B, N, K)
    scales: torch.Tensor  # (B, N, K)

    def prob_higher(self, candidates: torch.Tensor) -> torch.Tensor:
        """(B, N, C) candidates to (B, N, C) probabilities that the truth is higher."""
        above = (self.locations[..., None] - candidates[:, :, None]) / self.scales[..., None]
        mixed = (self.log_weights.exp()[..., None] * above.sigmoid()).sum(-2)
        return mixed.clamp(_MIN_PROBABILITY, 1 - _MIN_PROBABILITY)

    def cpu(self) -> "SurvivalMixture":
        """On the CPU."""
        return SurvivalMixture(self.log_weights.cpu(), self.locations.cpu(), self.scales.cpu())

    def sample(self, num: int, generator: torch.Generator) -> torch.Tensor:
        """(B, N, num) draws from the distributions that the curves describe."""
        shape = (*self.locations.shape[:-1], num)
        device = generator.device
        uniform = torch.rand(shape, generator=generator, device=device).clamp(1e-4, 1 - 1e-4)
        choice = torch.multinomial(
            self.log_weights.exp().flatten(0, 1), num, replacement=True, generator=generator
        ).view(shape)
        location, scale = self.locations.gather(-1, choice), self.scales.gather(-1, choice)
        return location + scale * uniform.logit()


def posterior_loss(
    curves: SurvivalMixture, truth: torch.Tensor, num_candidates: int, generator: torch.Generator
) -> torch.Tensor:
    """Binary cross-entropy of "is the truth (B, N) higher?" over random candidates (Sec. IV-A).

    Half of the candidates are uniform in the range and a little beyond, half are drawn from the
    network's own distribution, where the answer is hard. None depends on the truth.
    """
    with torch.no_grad():
        own = curves.sample(num_candidates, generator).clamp(*_CANDIDATE_BOUNDS)
        uniform = torch.rand(own.shape, generator=generator, device=own.device) * 1.2 - 0.1
        candidates = torch.cat([uniform, own], -1)
    is_higher = (truth[..., None] > candidates).float()
    return F.binary_cross_entropy(curves.prob_higher(candidates), is_higher)
