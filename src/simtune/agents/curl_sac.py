"""The paper's agent: soft actor-critic on pixels with random crops (RAD) and contrast (CURL).

One update, `CurlSac.learn`, encodes three crops: one of the frames, with gradients, and by the
slowly moving target, in one pass, another one of the frames and one of the next frames. The first
is the critics' input and CURL's query, the second CURL's key, the third the input of the critics'
target. So

* critics and contrast are one loss and one step for the encoder, not two in turn;
* the actor uses the *target's* convolutions, with a head of its own. In public implementations it
  uses the critics', which takes one more encoding of next and of present frames. It lags about 20
  of its steps behind, both when acting and when learning;
* the actor acts on the second crop, and the critics rate that action on the first, as they encoded
  it before their own step. In public implementations both see one crop, encoded anew.
"""

import copy
import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import nn

from simtune.agents.augment import centre_crop, random_crop
from simtune.agents.half_copy import HalfCopy
from simtune.agents.pixel_agent import PixelAgent, PixelAgentConfig
from simtune.agents.pixel_networks import (
    Contrast,
    GaussianActor,
    TwinQ,
    descend,
    initialize,
    move_towards,
    sample_squashed,
)
from simtune.agents.saving import Stateful
from simtune.networks.layers import autocast, seeded
from simtune.networks.pixel_encoder import NUM_FEATURES, PixelEncoder
from simtune.replay_buffer import Transitions


@dataclass(frozen=True, kw_only=True)
class CurlSacConfig(PixelAgentConfig):
    """RAD's settings (Laskin et al. 2020, appendix E), except for the paper's own batch size."""

    # observations
    image_size: int = 100  # pixels, drawn
    crop_size: int = 84  # pixels, cut out of them
    # networks
    log_std: tuple[float, float] = (-10.0, 2.0)
    # learning
    batch_size: int = 128  # the paper's appendix
    random_steps: int = 1000
    update_every: int = 1
    learning_rate: float = 1e-3
    beta1: float = 0.9
    init_temperature: float = 0.1
    temperature_learning_rate: float = 1e-4
    temperature_beta1: float = 0.5
    encoder_rate: float = 0.05  # τ of the encoder's target
    policy_period: int = 2  # updates between those of actor, temperature and targets

    def __post_init__(self) -> None:
        if self.crop_size > self.image_size:
            raise ValueError(f"no crop of {self.crop_size} fits into {self.image_size} pixels")


class Critic(nn.Module):
    """The encoder, and two Q functions of its features."""

    def __init__(self, num_actions: int, config: CurlSacConfig):
        super().__init__()
        self.encoder = PixelEncoder(3 * config.num_stacked, config.crop_size)
        self.q = TwinQ(NUM_FEATURES, num_actions, config.hidden_size)


class Temperature(nn.Module):
    """SAC's α, the weight of the entropy."""

    def __init__(self, first: float):
        super().__init__()
        self.log = nn.Parameter(torch.tensor(first).log())

    def forward(self) -> torch.Tensor:
        """(), positive."""
        return self.log.exp()


class CurlSac(PixelAgent):
    """Soft actor-critic on pixels, with a contrastive loss on its encoder."""

    losses = ("critic_loss", "contrast_loss", "q", "actor_loss", "entropy", "temperature")

    def __init__(
        self,
        num_actions: int,
        config: CurlSacConfig,
        *,
        seed: int,
        device: torch.device | str = "cpu",
        use_graphs: bool = True,
    ):
        """`use_graphs`: on CUDA updates and acting are captured as graphs, which is faster."""
        self.config = config
        super().__init__(num_actions, config, seed, device, use_graphs)
        with seeded(seed):
            self.critic = Critic(num_actions, config)
            num_maps = self.critic.encoder.convolutions.num_outputs
            self.actor = GaussianActor(num_maps, num_actions, config.hidden_size, config.log_std)
            self.contrast = Contrast()
            for module in (self.critic, self.actor):
                initialize(module)
        self.temperature = Temperature(config.init_temperature)
        self.target = copy.deepcopy(self.critic).requires_grad_(False)
        for module in (self.critic, self.actor, self.contrast, self.temperature, self.target):
            module.to(self.device)
        self._half_critic = HalfCopy(self.critic, self.device)
        self._half_target = HalfCopy(self.target, self.device)
        self._half_actor = HalfCopy(self.actor, self.device)
        self._make_optimizers()

    def _make_optimizers(self) -> None:
        config = self.config
        networks = partial(self._adam, lr=config.learning_rate, betas=(config.beta1, 0.999))
        self._critic_optimizer = networks([*self.critic.parameters(), *self.contrast.parameters()])
        self._actor_optimizer = networks(self.actor.parameters())
        self._temperature_optimizer = self._adam(
            self.temperature.parameters(),
            lr=config.temperature_learning_rate,
            betas=(config.temperature_beta1, 0.999),
        )

    @torch.no_grad()
    def _act(self, frames: torch.Tensor, sample: bool) -> torch.Tensor:
        with autocast(self.device):
            maps = self._half_target.used.encoder.convolutions(
                centre_crop(frames, self.config.crop_size)
            )
            return self.draw(maps)[0] if sample else self._half_actor.used(maps)[0].tanh()

    @property
    def _updates_policy(self) -> bool:
        return self._counter.num_updates % self.config.policy_period == 0

    def learn(self, batch: Transitions, updates_policy: bool = True) -> torch.Tensor:
        """One update; (6,) its `losses`, of the actor only if it `updates_policy`, else NaN."""
        frames, next_frames = batch.frames, batch.next_frames
        assert frames is not None
        assert next_frames is not None
        query, key, next_obs = map(self._crop, (frames, frames, next_frames))
        critic, target = self._half_critic.used, self._half_target.used.encoder
        with autocast(self.device):
            with torch.no_grad():
                maps, next_maps = target.convolutions(torch.cat([key, next_obs])).chunk(2)
                keys = target.head(maps).float()
                target_q = self.target_q(batch.rewards, batch.discounts, next_maps)
            features = critic.encoder(query)
            values = critic.q(features, batch.actions)  # (2, B)
        critic_loss = (values - target_q).square().mean(1).sum()
        contrast_loss = self.contrast.loss(features, keys)  # its logits are too large for bf16
        descend(critic_loss + contrast_loss, self._critic_optimizer, self._half_critic)

        losses = [critic_loss, contrast_loss, values.mean()]
        if updates_policy:
            losses += self.learn_policy(maps, features.detach())
            move_towards(self.target.encoder, self.critic.encoder, self.config.encoder_rate)
            move_towards(self.target.q, self.critic.q, self.config.critic_rate)
            self._half_target.refresh()
        else:
            losses += [torch.full_like(critic_loss, math.nan)] * 3
        return torch.stack(losses).detach()

    def target_q(
        self, rewards: torch.Tensor, discounts: torch.Tensor, maps: torch.Tensor
    ) -> torch.Tensor:
        """(B,) r + γ·d·(min Q'(o', a') − α·log π(a'|o')), a' the policy's, by (B, F) maps of o'."""
        actions, log_prob = self.draw(maps)
        target = self._half_target.used
        values = target.q(target.encoder.head(maps), actions).amin(0)
        soft = values - self.temperature() * log_prob
        return rewards + self.config.discount * discounts * soft

    def learn_policy(self, maps: torch.Tensor, features: torch.Tensor) -> list[torch.Tensor]:
        """The actor, by (B, F) feature maps and the critics' (B, 50) features; the temperature."""
        with autocast(self.device):
            actions, log_prob = self.draw(maps)
            values = self._half_critic.used.q(features, actions).amin(0)
        actor_loss = (self.temperature().detach() * log_prob - values).mean()
        descend(actor_loss, self._actor_optimizer, self._half_actor)
        entropy = -log_prob.detach().mean()
        temperature = self.temperature()
        descend(temperature * (entropy + self.num_actions), self._temperature_optimizer)
        return [actor_loss, entropy, temperature]

    def draw(self, maps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, F) feature maps to actions (B, A) of the policy and their log-probabilities (B,)."""
        mean, log_std = self._half_actor.used(maps)
        return sample_squashed(mean, log_std, self._generator)

    def _crop(self, frames: torch.Tensor) -> torch.Tensor:
        return random_crop(frames, self.config.crop_size, self._generator)

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """See `Agent`."""
        super().load(tensors, state)
        for half in (self._half_critic, self._half_target, self._half_actor):
            half.refresh()

    def _stateful(self) -> Stateful:
        return {
            "critic": self.critic,
            "target": self.target,
            "actor": self.actor,
            "contrast": self.contrast,
            "temperature": self.temperature,
            "critic_optimizer": self._critic_optimizer,
            "actor_optimizer": self._actor_optimizer,
            "temperature_optimizer": self._temperature_optimizer,
        }
