"""Batches that pixel agents' tests learn from."""

import torch

from simtune.replay import Transitions


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
