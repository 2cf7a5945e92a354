"""The same agent, written as the public implementations of CURL are: plain, eager, float32, NCHW.

Critics, actor and contrast are steps of their own, and each encodes its frames anew; the actor
shares the critics' convolutions; the encoder is moved by the critics' and by two more optimisers.
What a step computes is otherwise what `simtune.agents.curl_sac` says, with its sizes.
"""

import copy

import torch
from torch import nn
from torch.nn import functional

from simtune.agents.curl_sac import CurlSacConfig
from simtune.replay_buffer import ReplayBuffer


class Encoder(nn.Module):
    def __init__(self, num_channels: int, size: int):
        super().__init__()
        self.convs = nn.ModuleList([nn.Conv2d(num_channels, 32, 3, stride=2)])
        self.convs.extend(nn.Conv2d(32, 32, 3) for _ in range(3))
        side = (size - 3) // 2 + 1 - 6
        self.fc = nn.Linear(32 * side * side, 50)
        self.norm = nn.LayerNorm(50)

    def forward(self, frames: torch.Tensor, detach: bool = False) -> torch.Tensor:
        hidden = frames / 255
        for conv in self.convs:
            hidden = torch.relu(conv(hidden))
        hidden = hidden.flatten(1)
        if detach:
            hidden = hidden.detach()
        return self.norm(self.fc(hidden))


def three_layers(num_inputs: int, hidden: int, num_outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(num_inputs, hidden),
        nn.ReLU(),
        nn.Linear(hidden, hidden),
        nn.ReLU(),
        nn.Linear(hidden, num_outputs),
    )


class Actor(nn.Module):
    def __init__(self, num_actions: int, config: CurlSacConfig):
        super().__init__()
        self.config = config
        self.encoder = Encoder(3 * config.num_stacked, config.crop_size)
        self.trunk = three_layers(50, config.hidden_size, 2 * num_actions)

    def forward(self, frames: torch.Tensor, detach: bool = False):
        mean, log_std = self.trunk(self.encoder(frames, detach)).chunk(2, dim=-1)
        low, high = self.config.log_std
        log_std = low + 0.5 * (high - low) * (torch.tanh(log_std) + 1)
        noise = torch.randn_like(mean)
        action = torch.tanh(mean + noise * log_std.exp())
        normal = torch.distributions.Normal(0, 1)
        log_prob = (normal.log_prob(noise) - log_std).sum(-1, keepdim=True)
        log_prob = log_prob - torch.log(1 - action.square() + 1e-6).sum(-1, keepdim=True)
        return action, log_prob


class Critic(nn.Module):
    def __init__(self, num_actions: int, config: CurlSacConfig):
        super().__init__()
        self.encoder = Encoder(3 * config.num_stacked, config.crop_size)
        self.q1 = three_layers(50 + num_actions, config.hidden_size, 1)
        self.q2 = three_layers(50 + num_actions, config.hidden_size, 1)

    def forward(self, frames: torch.Tensor, action: torch.Tensor, detach: bool = False):
        both = torch.cat([self.encoder(frames, detach), action], dim=1)
        return self.q1(both), self.q2(both)


class EagerCurlSac:
    def __init__(self, num_actions: int, config: CurlSacConfig, device: torch.device | str):
        self.config, self.device = config, device
        self.target_entropy = -num_actions
        self.actor = Actor(num_actions, config).to(device)
        self.critic = Critic(num_actions, config).to(device)
        self.critic_target = copy.deepcopy(self.critic)
        for ours, theirs in zip(self.actor.encoder.convs, self.critic.encoder.convs, strict=True):
            ours.weight, ours.bias = theirs.weight, theirs.bias
        self.bilinear = nn.Parameter(torch.rand(50, 50, device=device))
        self.log_alpha = torch.tensor(config.init_temperature).log().to(device).requires_grad_()
        adam, encoder = torch.optim.Adam, self.critic.encoder
        self.actor_optimizer = adam(self.actor.parameters(), lr=config.learning_rate)
        self.critic_optimizer = adam(self.critic.parameters(), lr=config.learning_rate)
        self.alpha_optimizer = adam(
            [self.log_alpha],
            lr=config.temperature_learning_rate,
            betas=(config.temperature_beta1, 0.999),
        )
        self.encoder_optimizer = adam(encoder.parameters(), lr=config.learning_rate)
        self.contrast_optimizer = adam(
            [self.bilinear, *encoder.parameters()], lr=config.learning_rate
        )
        self.num_updates = 0

    def crop(self, frames: torch.Tensor) -> torch.Tensor:
        """(B, K, H, W, 3) uint8 to (B, 3·K, size, size) float32."""
        size = self.config.crop_size
        room = frames.shape[2] - size + 1
        places = torch.randint(room, (len(frames), 2)).tolist()
        cut = [f[:, y : y + size, x : x + size] for f, (y, x) in zip(frames, places, strict=True)]
        return torch.stack(cut).permute(0, 1, 4, 2, 3).float().flatten(1, 2).contiguous()

    def update(self, replay: ReplayBuffer, generator: torch.Generator) -> None:
        batch = replay.sample(self.config.batch_size, generator, with_frames=True)
        frames, positives = self.crop(batch.frames), self.crop(batch.frames)
        next_frames = self.crop(batch.next_frames)
        rewards, discounts = batch.rewards[:, None], batch.discounts[:, None]
        self.update_critic(frames, batch.actions, rewards, discounts, next_frames)
        if self.num_updates % self.config.policy_period == 0:
            self.update_actor_and_alpha(frames)
            self.update_targets()
        self.update_contrast(frames, positives)
        self.num_updates += 1

    def update_critic(self, frames, action, rewards, discounts, next_frames) -> None:
        with torch.no_grad():
            next_action, log_prob = self.actor(next_frames)
            q1, q2 = self.critic_target(next_frames, next_action)
            value = torch.min(q1, q2) - self.log_alpha.exp() * log_prob
            target = rewards + discounts * self.config.discount * value
        q1, q2 = self.critic(frames, action)
        loss = functional.mse_loss(q1, target) + functional.mse_loss(q2, target)
        self.critic_optimizer.zero_grad()
        loss.backward()
        self.critic_optimizer.step()

    def update_actor_and_alpha(self, frames) -> None:
        action, log_prob = self.actor(frames, detach=True)
        q1, q2 = self.critic(frames, action, detach=True)
        loss = (self.log_alpha.exp().detach() * log_prob - torch.min(q1, q2)).mean()
        self.actor_optimizer.zero_grad()
        loss.backward()
        self.actor_optimizer.step()
        self.alpha_optimizer.zero_grad()
        alpha_loss = self.log_alpha.exp() * (-log_prob - self.target_entropy).detach()
        alpha_loss.mean().backward()
        self.alpha_optimizer.step()

    def update_targets(self) -> None:
        pairs = (
            (self.critic.encoder, self.critic_target.encoder, self.config.encoder_rate),
            (self.critic.q1, self.critic_target.q1, self.config.critic_rate),
            (self.critic.q2, self.critic_target.q2, self.config.critic_rate),
        )
        for online, target, tau in pairs:
            for fast, slow in zip(online.parameters(), target.parameters(), strict=True):
                slow.data.copy_(tau * fast.data + (1 - tau) * slow.data)

    def update_contrast(self, frames, positives) -> None:
        queries = self.critic.encoder(frames)
        with torch.no_grad():
            keys = self.critic_target.encoder(positives)
        logits = queries @ (self.bilinear @ keys.T)
        logits = logits - logits.max(dim=1, keepdim=True).values
        loss = functional.cross_entropy(logits, torch.arange(len(logits), device=self.device))
        self.encoder_optimizer.zero_grad()
        self.contrast_optimizer.zero_grad()
        loss.backward()
        self.encoder_optimizer.step()
        self.contrast_optimizer.step()
