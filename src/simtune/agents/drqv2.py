"""DrQ-v2 (Yarats et al. 2021, arXiv:2107.09645): DDPG on pixels, with random shifts.

Its noise follows a schedule, so there is no temperature; only augmentation regularises the encoder.
Differences from the original: targets look one step ahead, not three, since a replay gives single
steps; pixels are scaled to 0 to 1, not to −½ to ½; convolutions begin as CURL's, of which only the
centres of kernels are not 0; noise falls from round to round, not from step to step.
"""

import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import nn

from simtune.agents.augment import random_shift
from simtune.agents.noise import disturbed, falling
from simtune.agents.pixel_agent import PixelAgent, PixelAgentConfig
from simtune.agents.pixel_networks import TwinQ, descend, initialize, move_towards
from simtune.agents.saving import Stateful
from simtune.networks.layers import autocast, mlp, seeded
from simtune.networks.pixel_encoder import NUM_FEATURES, PixelConvolutions, feature_head
from simtune.replay import Replay, Transitions


@dataclass(frozen=True, kw_only=True)
class DrqV2Config(PixelAgentConfig):
    """The authors' settings, for tasks of medium difficulty."""

    # observations
    image_size: int = 84  # pixels
    pad: int = 4  # largest shift in pixels
    # learning
    batch_size: int = 256
    random_steps: int = 2000  # the authors' 4,000 frames, two per step
    update_every: int = 2
    learning_rate: float = 1e-4
    # exploring
    noise: tuple[float, float] = (1.0, 0.1)  # standard deviation, first and last
    noise_steps: int = 500_000  # from one to the other
    noise_clip: float = 0.3  # in updates


class Critic(nn.Module):
    """Two Q functions of encoded frames, and the head that they share."""

    def __init__(self, num_inputs: int, num_actions: int, hidden_size: int):
        super().__init__()
        self.head = nn.Sequential(*feature_head(num_inputs), nn.Tanh())
        self.q = TwinQ(NUM_FEATURES, num_actions, hidden_size)

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """(B, F) and (B, A) to (2, B)."""
        return self.q(self.head(obs), actions)


class Actor(nn.Sequential):
    """(B, F) to the (B, A) actions that noise is added to."""

    def __init__(self, num_inputs: int, num_actions: int, hidden_size: int):
        layers = mlp((NUM_FEATURES, hidden_size, hidden_size, num_actions), nn.ReLU)
        super().__init__(*feature_head(num_inputs), nn.Tanh(), *layers, nn.Tanh())


class DrqV2(PixelAgent):
    """DDPG on pixels, with randomly shifted frames and scheduled noise."""

    losses = ("critic_loss", "q", "actor_loss", "noise")

    def __init__(
        self,
        num_actions: int,
        config: DrqV2Config | None = None,
        *,
        seed: int,
        device: torch.device | str = "cpu",
    ):
        self.config = config = config or DrqV2Config()
        super().__init__(num_actions, config, seed, device, use_graphs=True)
        self._noise = torch.full((), config.noise[0], device=self.device)  # where graphs read it
        with seeded(seed):
            self.encoder = PixelConvolutions(3 * config.num_stacked, config.image_size)
            sizes = (self.encoder.num_outputs, num_actions, config.hidden_size)
            self.critic, self.actor = Critic(*sizes), Actor(*sizes)
            for module in (self.encoder, self.critic, self.actor):
                initialize(module)
        self.target = copy.deepcopy(self.critic).requires_grad_(False)
        for module in (self.encoder, self.critic, self.actor, self.target):
            module.to(self.device)
        adam = partial(self._adam, lr=config.learning_rate)
        # Only the critics train the encoder.
        self._critic_optimizer = adam([*self.encoder.parameters(), *self.critic.parameters()])
        self._actor_optimizer = adam(self.actor.parameters())

    @property
    def noise(self) -> float:
        """The present standard deviation of exploration."""
        return falling(self.config.noise, self._counter.num_collected / self.config.noise_steps)

    @torch.no_grad()
    def _act(self, frames: torch.Tensor, sample: bool) -> torch.Tensor:
        with autocast(self.device):
            actions = self.actor(self.encoder(frames)).float()
        return disturbed(actions, self._noise, self._generator) if sample else actions

    def update(self, replay: Replay, num_steps: int) -> dict[str, float]:
        """See `Agent`."""
        losses = super().update(replay, num_steps)
        self._noise.fill_(self.noise)
        return losses

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """See `Agent`."""
        super().load(tensors, state)
        self._noise.fill_(self.noise)

    def learn(self, batch: Transitions, updates_policy: bool = True) -> torch.Tensor:
        """One update, always of the policy, too; (4,) its `losses`."""
        assert batch.frames is not None
        assert batch.next_frames is not None
        with autocast(self.device), torch.no_grad():
            next_obs = self.encoder(self._shift(batch.next_frames))
            target_q = self.target_q(batch.rewards, batch.discounts, next_obs)
        with autocast(self.device):  # separate: weights that were cast above would get no gradient
            obs = self.encoder(self._shift(batch.frames))
            values = self.critic(obs, batch.actions)  # (2, B)
        critic_loss = (values - target_q).square().mean(1).sum()
        descend(critic_loss, self._critic_optimizer)

        obs = obs.detach()
        with autocast(self.device):
            actions = self._act_nearby(obs)
            actor_loss = -self.critic(obs, actions).amin(0).mean()
        descend(actor_loss, self._actor_optimizer)

        move_towards(self.target, self.critic, self.config.critic_rate)
        return torch.stack([critic_loss, values.mean(), actor_loss, self._noise]).detach()

    def target_q(
        self, rewards: torch.Tensor, discounts: torch.Tensor, next_obs: torch.Tensor
    ) -> torch.Tensor:
        """(B,) r + γ·d·min Q'(o', a'), a' the actor's with clipped noise; (B, F) encoded o'."""
        actions = self._act_nearby(next_obs)
        values = self.target(next_obs, actions).amin(0)
        return rewards + self.config.discount * discounts * values

    def _act_nearby(self, obs: torch.Tensor) -> torch.Tensor:
        """The actor's actions with clipped noise."""
        actions = self.actor(obs).float()
        return disturbed(actions, self._noise, self._generator, self.config.noise_clip)

    def _shift(self, frames: torch.Tensor) -> torch.Tensor:
        return random_shift(frames, self.config.pad, self._generator)

    def _stateful(self) -> Stateful:
        return {
            "encoder": self.encoder,
            "critic": self.critic,
            "target": self.target,
            "actor": self.actor,
            "critic_optimizer": self._critic_optimizer,
            "actor_optimizer": self._actor_optimizer,
        }
