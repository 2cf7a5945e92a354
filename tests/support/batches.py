"""Batches that pixel agents' tests learn from."""

from dataclasses import dataclass, fields

import torch

from simtune.agents.pixel_agent import PixelAgent
from simtune.replay_buffer import Transitions


@dataclass
class Same:
    """In place of a replay: one batch, again and again."""

    batch: Transitions
    num_filmed_steps = 1

    def sample(self, *_, **__) -> Transitions:
        """As a replay does."""
        return self.batch

    def on(self, device: str) -> "Same":
        """The same batch on another device."""
        names = (field.name for field in fields(self.batch))
        return Same(Transitions(**{name: getattr(self.batch, name).to(device) for name in names}))


def learn_now(agent: PixelAgent, replay, num_updates: int = 1) -> dict[str, float]:
    """Updates for as many steps, without exploring meanwhile; the means of their losses."""
    agent.update(replay, num_updates)
    return agent.update(replay, 0)


def pixel_batch(image_size: int, n: int = 4) -> Transitions:
    """Random steps with stacks of two frames, two actions, and nothing but pixels known."""
    draw = torch.Generator().manual_seed(0)
    shape = (n, 3, image_size, image_size, 3)
    seen = torch.randint(256, shape, generator=draw, dtype=torch.uint8)
    return Transitions(
        states=torch.empty(n, 0),
        actions=2 * torch.rand(n, 2, generator=draw) - 1,
        rewards=torch.rand(n, generator=draw),
        discounts=torch.ones(n),
        next_states=torch.empty(n, 0),
        parameters=torch.empty(n, 0),
        frames=seen[:, :-1],
        next_frames=seen[:, 1:],
    )
