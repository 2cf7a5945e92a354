"""The paper's q_φ: windows of 10 frames, and a candidate to compare with (Sec. IV-A, V).

It corrects what the authors' code does differently from the idea: dropout is off in predictions,
candidates are encoded on a normalised scale, and all windows of an episode have a vote.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from simtune.networks.layers import autocast, mlp, positional_encoding, predicting
from simtune.networks.pixel_encoder import NUM_FEATURES, PixelEncoder
from simtune.parameters import ParameterSpace
from simtune.search_param_model.windows import Windows, split
from simtune.trajectory import Trajectory

Method = Literal["paper", "regression"]
_LEAST_SPREAD = 1e-6  # for a constant reading
_CHUNK = 64  # windows encoded at once in predictions, which limits memory


@dataclass(frozen=True, kw_only=True)
class PaperConfig:
    """The paper's settings. "Code" marks values that only the authors' code gives."""

    # the network
    window: int = 10  # frames, Sec. V
    crop_size: int = 84  # pixels, appendix (RAD's crop)
    octaves: int = 10  # code (NeRF's own value for positions)
    hidden_size: int = 400  # appendix
    dropout: float = 0.5  # appendix
    # training
    learning_rate: float = 1e-3  # appendix
    beta1: float = 0.9  # appendix
    batch_size: int = 16  # trajectories, code
    num_candidates: int = 512  # for each window, code ("about")
    updates_per_episode: int = 10  # code
    # collecting
    episodes_per_iteration: int = 10  # code: 2k steps between two updates of ξ_mean
    episode_steps: int = 200  # appendix
    range_spm: float = 1.0  # Sec. VI-A
    # The authors collect 50k steps and then pretrain for 50k more (as `train --preset paper` does).
    # That is 2,500 updates, up to half an hour on 2 CPU cores before anything moves; colours, which
    # settle first, need less.
    collect_steps: int = 10_000
    pretrain_steps: int = 10_000
    # D_sp, but see `num_kept`: 100 episodes of 200 steps and 100 × 100 pixels are 0.6 GB, and not
    # from a much older Ξ
    buffer_episodes: int = 100
    # moving
    step_size: float = 0.1  # α, code
    unsure: tuple[float, float] = (0.3, 0.7)  # code: a probability in between counts as ½
    max_moves: int = 100  # code: 71 to 101 updates of ξ_mean

    @property
    def num_kept(self) -> int:
        """Episodes that D_sp has room for: at least `collect_steps`.

        50,000 steps at 100 × 100 pixels are 1.5 GB. The authors keep up to 100,000.
        """
        return max(self.buffer_episodes, math.ceil(self.collect_steps / self.episode_steps))


class PaperSearchParamModel(nn.Module):
    """q_φ(frames, actions, candidate) → P(truth > candidate), one for each parameter.

    method="regression" is the paper's baseline: the same network without a candidate, which
    predicts the parameters' unit coordinates.
    """

    def __init__(
        self,
        config: PaperConfig,
        space: ParameterSpace,
        action_scale: np.ndarray,  # (A,) largest magnitude of each action, scaled to 1
        method: Method = "paper",
        num_readings: int = 0,
    ):
        """`num_readings`: numbers that sensors add to each frame (end of Sec. V)."""
        super().__init__()
        self.config = config
        self.space = space
        self.register_buffer("action_scale", torch.as_tensor(action_scale, dtype=torch.float32))
        self.encoder = PixelEncoder(3 * config.window, config.crop_size)
        self.register_buffer("usual_reading", torch.zeros(num_readings))
        self.register_buffer("reading_spread", torch.ones(num_readings))
        num_features = NUM_FEATURES + config.window * (len(action_scale) + num_readings)
        if method == "paper":
            num_features += len(space) * (2 * config.octaves + 1)
        hidden = config.hidden_size
        self.head = mlp((num_features, hidden, hidden, len(space)), nn.ELU, config.dropout)

    @property
    def device(self) -> torch.device:
        return self.get_buffer("action_scale").device

    def scale_readings(self, readings: np.ndarray) -> None:
        """Normalise future readings as (n, T, R) typical ones are; NaN: nothing was read."""
        mean = np.nanmean(readings, (0, 1))
        spread = np.maximum(np.nanstd(readings, (0, 1)), _LEAST_SPREAD)
        self.get_buffer("usual_reading").copy_(torch.as_tensor(mean))
        self.get_buffer("reading_spread").copy_(torch.as_tensor(spread))

    def forward(self, windows: Windows, candidates: np.ndarray | None = None) -> torch.Tensor:
        """Logits (B, C, N) for (C, N) candidates in their units; (B, N) coordinates without.

        The encoder runs once per window, for any number of candidates.
        """
        with autocast(self.device):
            context = self._context(windows)
            if candidates is None:
                return self.head(context).float()
            unit = torch.as_tensor(self.space.to_unit(candidates), dtype=torch.float32)
            encoded = positional_encoding(unit.to(self.device), self.config.octaves)  # (C, E)
            # The first layer applied to [context, encoded], without repeating either for each pair.
            first = self.head[0]
            assert isinstance(first, nn.Linear)
            of_context, of_candidate = first.weight.split([context.shape[1], encoded.shape[1]], 1)
            hidden = functional.linear(context, of_context)[:, None]  # (B, 1, hidden)
            hidden = hidden + functional.linear(encoded, of_candidate, first.bias)
            return self.head[1:](hidden).float()

    def loss(self, windows: Windows, truth: np.ndarray, candidates: np.ndarray) -> torch.Tensor:
        """Binary cross-entropy of is_higher = truth > candidate, for (B, N) and (C, N)."""
        is_higher = torch.as_tensor(truth[:, None] > candidates, dtype=torch.float32)
        logits = self(windows, candidates)
        return functional.binary_cross_entropy_with_logits(logits, is_higher.to(self.device))

    def regression_loss(self, windows: Windows, truth: np.ndarray) -> torch.Tensor:
        """Mean squared error of the unit coordinates, which is independent of units."""
        unit = torch.as_tensor(self.space.to_unit(truth), dtype=torch.float32)
        return functional.mse_loss(self(windows), unit.to(self.device))

    def prob_higher(self, trajectories: Sequence[Trajectory], candidate: np.ndarray) -> np.ndarray:
        """(N,) share of windows that call the truth higher, averaged over the episodes."""
        with predicting(self):
            return np.mean(
                [
                    count_votes(torch.sigmoid(logits[:, 0]).numpy(), self.config.unsure)
                    for logits in self._over_episodes(trajectories, candidate[None])
                ],
                axis=0,
            )

    def predict(self, trajectories: Sequence[Trajectory]) -> np.ndarray:
        """(N,) parameters, by regression: coordinates averaged over windows, then episodes."""
        with predicting(self):
            episodes = [unit.numpy().mean(0) for unit in self._over_episodes(trajectories, None)]
        return self.space.from_unit(np.mean(episodes, axis=0))

    def _over_episodes(
        self, trajectories: Sequence[Trajectory], candidates: np.ndarray | None
    ) -> Iterator[torch.Tensor]:
        """The network's output for all windows of each episode, on the CPU."""
        for trajectory in trajectories:
            windows = split(trajectory, self.config.window, self.config.crop_size)
            chunks = [slice(i, i + _CHUNK) for i in range(0, len(windows), _CHUNK)]
            yield torch.cat([self(windows.take(c), candidates).cpu() for c in chunks])

    def _context(self, windows: Windows) -> torch.Tensor:
        """(B, 50 + W·(A + R)) features of frames, actions and readings of a window."""
        frames = torch.as_tensor(windows.frames).to(self.device)
        actions = torch.as_tensor(windows.actions, dtype=torch.float32).to(self.device)
        scaled = (actions / self.get_buffer("action_scale")).flatten(1)
        read = windows.readings.to(self.device) - self.get_buffer("usual_reading")
        read = torch.nan_to_num(read / self.get_buffer("reading_spread")).flatten(1)
        return torch.cat([self.encoder(frames), scaled, read], 1)


def count_votes(probabilities: np.ndarray, unsure: tuple[float, float]) -> np.ndarray:
    """(W, N) probabilities of windows to their mean vote (N,): 1 higher, 0 lower, ½ unsure."""
    low, high = unsure
    is_unsure = (probabilities > low) & (probabilities < high)
    return np.where(is_unsure, 0.5, np.round(probabilities)).mean(0)
