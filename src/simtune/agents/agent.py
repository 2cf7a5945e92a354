"""What an agent is: it acts on pixels, and learns from simulated worlds."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch

from simtune.replay import Replay


@dataclass(frozen=True)
class Seen:
    """What there is to see of n simulated worlds at a moment."""

    state: np.ndarray  # (n, D) of `Task.observe`; a real world has none
    frames: np.ndarray | None  # (n, K, H, W, 3) uint8, the newest last; None where nobody looks


class Agent(Protocol):
    """Actions are in [−1, 1], one row a world. The real world calls `act` alone."""

    device: torch.device  # of its networks, and of the replay that it learns from

    @property
    def looks(self) -> bool:
        """Whether it wants frames of the next simulated episodes; drawing them is what costs."""
        ...

    @property
    def is_ready(self) -> bool:
        """Whether it has learnt anything of acting on frames yet, to be tried out in reality."""
        ...

    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """(n, K, H, W, 3) uint8 frames to (n, A) actions: the best, or drawn from the policy."""
        ...

    def explore(self, seen: Seen) -> np.ndarray:
        """(n, A) actions in simulated worlds, to learn from."""
        ...

    def update(self, replay: Replay, num_steps: int) -> dict[str, float]:
        """Learn for `num_steps` newly collected steps; losses to be logged, always the same keys.

        How many updates that is, the agent knows.
        """
        ...

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint has to hold besides `state`: weights, targets, moments."""
        ...

    def state(self) -> dict[str, Any]:
        """JSON, random states included."""
        ...

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Go on from a checkpoint as if there had been no break."""
        ...
