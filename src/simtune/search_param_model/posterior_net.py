"""Judge: from what was seen and done over several episodes to P(truth > candidate)."""

from dataclasses import dataclass

import torch
from torch import nn
from torch.nn import functional as F

SHORTEST_STEPS = 21  # that the convolutions over time need
_EDGE = 1e-5  # probabilities are kept this far from 0 and 1


@dataclass(frozen=True, kw_only=True)
class PosteriorNetConfig:
    channels: int = 64
    hidden: int = 128
    components: int = 3
    batch_size: int = 32
    learning_rate: float = 4e-3
    weight_decay: float = 1e-2
    candidates: int = 64  # of each kind, for each world of a batch
    shortest_crop: int = 40  # steps
    crop_lengths: int = 8  # different ones


class PosteriorNet(nn.Module):
    """The set of a world's episodes to one survival curve a parameter.

    Episodes of one world are one question: their features are pooled inside the network, and
    it is trained on such sets. (Multiplying the curves of single episodes would count the
    prior once for each.) The curve is a mixture of logistics, so it falls by construction.
    Coordinates are those of the range searched: -1 at its low end, 1 at its high end.
    """

    most_episodes: torch.Tensor  # () that it was taught on at a time

    def __init__(
        self, num_seen: int, visible: list[int], num_parameters: int, config: PosteriorNetConfig
    ):
        super().__init__()
        c, self.components = config.channels, config.components
        self.num_parameters = num_parameters
        self.visible = visible  # indices of the parameters that the detector estimates
        self.first = nn.Conv1d(num_seen, c, 5, stride=2)  # half the work, and nothing lost
        self.later = nn.ModuleList([nn.Conv1d(c, c, 5) for _ in range(2)])
        self.head = nn.Sequential(
            nn.Linear(2 * c + 2 + len(visible), config.hidden),
            nn.ELU(),
            nn.Linear(config.hidden, config.hidden),
            nn.ELU(),
            nn.Linear(config.hidden, 3 * self.components * num_parameters),
        )
        self.register_buffer("most_episodes", torch.tensor(1))
        spread = torch.linspace(-0.5, 0.5, self.components)
        self.register_buffer("spread", spread, persistent=False)

    def forward(self, seen: torch.Tensor, visible: torch.Tensor) -> "SurvivalMixture":
        """(B, E, T, S) keypoints and actions, (B, V) pooled visible estimates, to B × N curves."""
        worlds, episodes, steps, _ = seen.shape
        x = F.elu(self.first(seen.reshape(worlds * episodes, steps, -1).transpose(1, 2)))
        for conv in self.later:
            x = F.elu(conv(x)) + x[..., 2:-2]
        pooled = torch.cat([x.mean(-1), (x.square().mean(-1) + 1e-6).sqrt()], -1)
        pooled = pooled.view(worlds, episodes, -1).mean(1)
        # Means do not tell over how much they were taken, which is what the curves' width is of.
        # Of more episodes than it knows it is told as many as it knows: too wide, if anything.
        episodes = min(episodes, int(self.most_episodes))
        amount = pooled.new_tensor([episodes, steps / SHORTEST_STEPS]).log().expand(worlds, -1)
        out = self.head(torch.cat([pooled, amount, visible], -1))
        weights, places, scales = out.view(worlds, self.num_parameters, 3, -1).unbind(2)
        known = torch.zeros_like(places)
        known[:, self.visible] = visible[..., None]  # so that only corrections need learning
        places = places + known
        return SurvivalMixture(
            weights.log_softmax(-1), places + self.spread, (scales - 1.5).exp() + 1e-3
        )


@dataclass(frozen=True)
class SurvivalMixture:
    """Mixtures of logistics: P(truth > candidate) for B worlds and N parameters."""

    log_weights: torch.Tensor  # (B, N, K)
    places: torch.Tensor  # (B, N, K)
    scales: torch.Tensor  # (B, N, K)

    def prob_higher(self, candidates: torch.Tensor) -> torch.Tensor:
        """(B, N, C) candidates to (B, N, C) probabilities that the truth is higher."""
        above = (self.places[..., None] - candidates[:, :, None]) / self.scales[..., None]
        mixed = (self.log_weights.exp()[..., None] * above.sigmoid()).sum(-2)
        return mixed.clamp(_EDGE, 1 - _EDGE)

    def sample(self, num: int, generator: torch.Generator) -> torch.Tensor:
        """(B, N, num) draws from the distributions that the curves describe."""
        shape = (*self.places.shape[:-1], num)
        uniform = torch.rand(shape, generator=generator).clamp(1e-4, 1 - 1e-4)
        choice = torch.multinomial(
            self.log_weights.exp().flatten(0, 1), num, replacement=True, generator=generator
        ).view(shape)
        place, scale = self.places.gather(-1, choice), self.scales.gather(-1, choice)
        return place + scale * uniform.logit()


def posterior_loss(
    curves: SurvivalMixture, truth: torch.Tensor, num_candidates: int, generator: torch.Generator
) -> torch.Tensor:
    """Binary cross-entropy of "is the truth (B, N) higher?" over random candidates.

    Half of the candidates are uniform in the range, half are drawn where the posterior network itself
    believes the truth to be, since that is where telling is hard. None depends on the truth.
    """
    with torch.no_grad():
        own = curves.sample(num_candidates, generator).clamp(-3, 3)
        uniform = torch.rand(own.shape, generator=generator) * 2.4 - 1.2
        candidates = torch.cat([uniform, own], -1)
    is_higher = (truth[..., None] > candidates).float()
    return F.binary_cross_entropy(curves.prob_higher(candidates), is_higher)
