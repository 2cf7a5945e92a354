"""A teacher that knows the simulator's state: an actor and twin critics without pictures.

In simulation the state is free, and a policy on it is learnt in minutes where pixels take hours. It
never meets the real world: a student on pixels learns from it (`student.py`).

It is TD3 (Fujimoto et al. 2018, arXiv:1802.09477) as in DrQ-v2 (Yarats et al. 2021,
arXiv:2107.09645): no delayed updates, and scheduled noise. A learnt temperature, as in SAC, stops
exploring at the first reward, and sticks to what gave it.
"""

import copy
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from simtune.agents.noise import disturbed
from simtune.agents.pixel_networks import move_towards
from simtune.networks.layers import Standardizer, frozen, mlp
from simtune.replay_buffer import Transitions


@dataclass(frozen=True, kw_only=True)
class TeacherConfig:
    """TD3's and DrQ-v2's settings, unless said otherwise."""

    hidden_size: int = 256  # TD3's code
    batch_size: int = 128  # half of theirs, for nearly the same progress per update
    learning_rate: float = 1e-3  # with normalised critics faster than 3e-4
    discount: float = 0.99
    target_rate: float = 0.01  # the paper's critic τ
    noise: tuple[float, float] = (1.0, 0.1)  # standard deviation, first and last: DrQ-v2's
    noise_clip: float = 0.3  # in updates, DrQ-v2's
    # On squared pre-tanh actions (Andrychowicz et al. 2017, arXiv:1707.01495, app. A). Far out the
    # tanh has no gradient, and without rewards everything drifts there.
    saturation_cost: float = 0.01


class Teacher(nn.Module):
    """Acts on (B, D) states. The critics also see the (B, N) parameters of the world.

    The actor does not, so that a student without them can follow its policy. `noise` is the
    standard deviation of exploration.
    """

    def __init__(
        self, num_states: int, num_actions: int, num_parameters: int, config: TeacherConfig
    ):
        super().__init__()
        self.config = config
        hidden = (config.hidden_size, config.hidden_size)
        self.actor = mlp((num_states, *hidden, num_actions), nn.ReLU)  # before the tanh
        self.critics = TwinCritic(num_states + num_parameters + num_actions, config.hidden_size)
        self.targets = copy.deepcopy(self.critics).requires_grad_(False)
        self.normalized = Standardizer(num_states, added_std=1e-3)
        learning = [*self.actor.parameters(), *self.critics.parameters()]
        self.optimizer = torch.optim.Adam(learning, config.learning_rate, fused=True)

    def act(self, states: torch.Tensor) -> torch.Tensor:
        """(B, D) unnormalised states to the best (B, A) actions."""
        with torch.no_grad():
            return self.actor(self.normalized(states)).tanh()

    def update(
        self, batch: Transitions, noise: float | torch.Tensor, generator: torch.Generator
    ) -> torch.Tensor:
        """One joint step for critics and actor; (2,) their losses."""
        states, next_states = self.normalized(batch.states), self.normalized(batch.next_states)
        known = batch.parameters
        target_q = self.target_q(batch, next_states, noise, generator)
        values = self.critics(torch.cat([states, known, batch.actions], 1))  # (2, B)
        critic_loss = (values - target_q).square().mean(1).sum()

        before = self.actor(states)
        actions = disturbed(before.tanh(), noise, generator, self.config.noise_clip)
        with frozen(self.critics):
            value = self.critics(torch.cat([states, known, actions], 1)).amin(0)
        actor_loss = self.config.saturation_cost * before.square().mean() - value.mean()

        self.optimizer.zero_grad()
        (critic_loss + actor_loss).backward()
        self.optimizer.step()
        move_towards(self.targets, self.critics, self.config.target_rate)
        return torch.stack([critic_loss, actor_loss]).detach()

    @torch.no_grad()
    def target_q(
        self,
        batch: Transitions,
        next_states: torch.Tensor,
        noise: float | torch.Tensor,
        generator: torch.Generator,
    ) -> torch.Tensor:
        """(B,) r + γ·d·min Q'(s', a'), a' the actor's with clipped noise; normalised s'."""
        best = self.actor(next_states).tanh()
        actions = disturbed(best, noise, generator, self.config.noise_clip)
        value = self.targets(torch.cat([next_states, batch.parameters, actions], 1)).amin(0)
        return batch.rewards + self.config.discount * batch.discounts * value


class TwinCritic(nn.Module):
    """Two networks of two hidden layers, computed as one; layer norm bounds their values.

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
