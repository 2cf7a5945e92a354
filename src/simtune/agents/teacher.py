"""A teacher that knows the simulator's state: soft actor-critic without pictures.

In simulation the state is free, and a policy on it is learnt in minutes where pixels take hours.
It never meets the real world: what it knows, a student on pixels is taught (`student.py`).
"""

import copy
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from simtune.agents.pixel_networks import move_towards
from simtune.agents.squashed import bounded_log_std, sample_squashed
from simtune.networks import frozen, mlp
from simtune.replay import Transitions


@dataclass(frozen=True, kw_only=True)
class TeacherConfig:
    """Haarnoja et al. 2018 (arXiv:1812.05905, table 1), unless said otherwise."""

    hidden_size: int = 256
    batch_size: int = 128  # half of theirs, for nearly the same progress an update
    learning_rate: float = 1e-3  # theirs is 3e-4; with normalised critics this is faster
    discount: float = 0.99
    target_rate: float = 0.01  # the paper's critic τ
    init_temperature: float = 0.1  # the paper's
    # It falls while nothing is earned yet, and has to be back before the policy settles on less.
    temperature_learning_rate: float = 5e-3
    log_std: tuple[float, float] = (-5.0, 2.0)


class Teacher(nn.Module):
    """SAC on (B, D) states. The critics also see the (B, N) parameters of the world.

    The actor does not, so that its policy is one that somebody without them can follow.
    """

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(
        self, num_states: int, num_actions: int, num_parameters: int, config: TeacherConfig
    ):
        super().__init__()
        self.config = config
        hidden = (config.hidden_size, config.hidden_size)
        self.actor = mlp((num_states, *hidden, 2 * num_actions), nn.ReLU)
        self.critics = TwinCritic(num_states + num_parameters + num_actions, config.hidden_size)
        self.targets = copy.deepcopy(self.critics).requires_grad_(False)
        self.log_temperature = nn.Parameter(torch.tensor(config.init_temperature).log())
        # Ball et al.'s (see `TwinCritic`): by Haarnoja et al.'s −A finger settled on less.
        self.target_entropy = -num_actions / 2
        self.register_buffer("mean", torch.zeros(num_states))
        self.register_buffer("std", torch.ones(num_states))
        parts = [self.actor, self.critics]
        self._optimizer = torch.optim.Adam(
            [p for part in parts for p in part.parameters()], config.learning_rate, fused=True
        )
        self._temperature_optimizer = torch.optim.Adam(
            [self.log_temperature], config.temperature_learning_rate
        )

    def normalize_by(self, states: torch.Tensor) -> None:
        """From now on (B, D) such states have mean 0 and standard deviation 1 for the networks."""
        self.mean.copy_(states.mean(0))
        self.std.copy_(states.std(0) + 1e-3)

    def normalized(self, states: torch.Tensor) -> torch.Tensor:
        return ((states - self.mean) / self.std).clamp(-10, 10)

    def act(self, states: torch.Tensor) -> torch.Tensor:
        """(B, D) states as they are to the best (B, A) actions."""
        with torch.no_grad():
            return self._policy(self.normalized(states))[0].tanh()

    def sample(self, states: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """(B, A) actions drawn from the policy."""
        with torch.no_grad():
            return sample_squashed(*self._policy(self.normalized(states)), generator)[0]

    def update(self, batch: Transitions, generator: torch.Generator) -> dict[str, torch.Tensor]:
        """One step for critics, actor and temperature, together; their losses."""
        states, next_states = self.normalized(batch.states), self.normalized(batch.next_states)
        known = batch.parameters
        target = self.target(batch, next_states, generator)
        values = self.critics(torch.cat([states, known, batch.actions], 1))  # (2, B)
        critic_loss = (values - target).square().mean(1).sum()

        actions, log_prob = sample_squashed(*self._policy(states), generator)
        with frozen(self.critics):
            value = self.critics(torch.cat([states, known, actions], 1)).amin(0)
        temperature = self.log_temperature.exp().detach()
        actor_loss = (temperature * log_prob - value).mean()

        self._optimizer.zero_grad()
        (critic_loss + actor_loss).backward()
        self._optimizer.step()
        entropy_gap = (log_prob.detach() + self.target_entropy).mean()
        self._temperature_optimizer.zero_grad()
        (-self.log_temperature.exp() * entropy_gap).backward()
        self._temperature_optimizer.step()
        move_towards(self.targets, self.critics, self.config.target_rate)
        return {"critic": critic_loss.detach(), "actor": actor_loss.detach()}

    @torch.no_grad()
    def target(
        self, batch: Transitions, next_states: torch.Tensor, generator: torch.Generator
    ) -> torch.Tensor:
        """(B,) r + γ·d·(min Q'(s', a') − α·log π(a'|s')), a' drawn from the policy."""
        actions, log_prob = sample_squashed(*self._policy(next_states), generator)
        value = self.targets(torch.cat([next_states, batch.parameters, actions], 1)).amin(0)
        soft = value - self.log_temperature.exp() * log_prob
        return batch.rewards + self.config.discount * batch.discounts * soft

    @property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        return {"optimizer": self._optimizer, "temperature": self._temperature_optimizer}

    def _policy(self, states: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, D) normalised states to means and log standard deviations before the tanh."""
        mean, spread = self.actor(states).chunk(2, -1)
        return mean, bounded_log_std(spread, self.config.log_std)


class TwinCritic(nn.Module):
    """Two networks of two hidden layers, computed as one; layer norm keeps values in bounds.

    (Ball et al. 2023, arXiv:2302.02948, for the norm.)
    """

    def __init__(self, num_inputs: int, hidden_size: int):
        super().__init__()
        pairs = list(pairwise((num_inputs, hidden_size, hidden_size, 1)))
        self.weights = nn.ParameterList(
            torch.empty(2, i, o).uniform_(-(i**-0.5), i**-0.5) for i, o in pairs
        )
        self.biases = nn.ParameterList(torch.zeros(2, 1, o) for _, o in pairs)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(B, I) to (2, B)."""
        hidden = inputs.expand(2, *inputs.shape)
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            hidden = torch.baddbmm(bias, hidden, weight)
            if i < len(self.weights) - 1:
                hidden = functional.relu(functional.layer_norm(hidden, hidden.shape[-1:]))
        return hidden[..., 0]
