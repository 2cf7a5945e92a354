"""What an agent is: it acts on pixels, and learns from simulated worlds."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch

from simtune.replay import Replay
from simtune.vision.image_noise import ImageNoise


@dataclass(frozen=True, kw_only=True)
class AgentSpec:
    """What an agent is made for."""

    image_size: int  # pixels a side of the square pictures that it acts on
    num_stacked: int  # of them, the latest ones
    num_keypoints: int
    num_states: int
    num_positions: int  # the first of the states
    num_actions: int
    most_late: int = 0  # steps by which actions may be late; so many of them end the states
    image_noise: ImageNoise | None = None  # of the real camera, which simulated pictures lack
    privileged: np.ndarray  # (N,) bool: parameters that may be used where the state may be, too
    total_steps: int  # of the whole training, for what changes in its course
    first_tried: int  # steps after which it is first tried out in the real world
    round_steps: int  # between two updates
    seed: int
    device: torch.device | str


@dataclass(frozen=True)
class Observation:
    """What can be observed of n simulated worlds at a moment."""

    state: np.ndarray  # (n, D) of `rollout.Environment.observe`; a real world has none
    frames: np.ndarray | None  # (n, K, H, W, 3) uint8, the newest last; None where not drawn


class Agent(Protocol):
    """Actions are in [−1, 1], one row a world. The real world calls `act` alone."""

    device: torch.device  # of its networks, and of the replay that it learns from

    @property
    def wants_frames(self) -> bool:
        """Whether the next simulated episodes are to be filmed; drawing frames is what costs."""
        ...

    @property
    def can_act(self) -> bool:
        """Whether it has begun to learn to act on frames, and can be tried out in reality."""
        ...

    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """(n, K, H, W, 3) uint8 frames to (n, A) actions: the best, or drawn from the policy."""
        ...

    def explore(self, observation: Observation) -> np.ndarray:
        """(n, A) actions in simulated worlds, to learn from."""
        ...

    def update(self, replay: Replay, num_steps: int) -> dict[str, float]:
        """Learn for `num_steps` newly collected steps; losses to be logged, always the same keys.

        The agent itself decides how many updates that is.
        """
        ...

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint has to hold besides `state`: weights, targets, moments."""
        ...

    def state(self) -> dict[str, Any]:
        """JSON, random states included."""
        ...

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Go on from a checkpoint as if there had been no break.

        Raises InputError for one of other networks.
        """
        ...
