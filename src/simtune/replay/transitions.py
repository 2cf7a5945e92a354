"""A batch of single steps, as an agent learns from it."""

from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Transitions:
    """B steps of simulated worlds, drawn from all stored episodes."""

    states: torch.Tensor  # (B, D) float32 of `Environment.observe`: known in simulation only
    actions: torch.Tensor  # (B, A) float32 in [−1, 1]
    rewards: torch.Tensor  # (B,) float32
    discounts: torch.Tensor  # (B,) float32: 0 where the task ended, 1 where only the time did
    next_states: torch.Tensor  # (B, D)
    parameters: torch.Tensor  # (B, N) float32 of their worlds, as coordinates in [0, 1]
    # (B, K, H, W, 3) uint8, the oldest first; before an episode's first frame that one is repeated
    frames: torch.Tensor | None = None
    next_frames: torch.Tensor | None = None
