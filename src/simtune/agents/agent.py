"""The interface of agents, which act on pixels and learn from simulated worlds."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch

from simtune.replay_buffer import ReplayBuffer
from simtune.vision.image_noise import ImageNoise


@dataclass(frozen=True, kw_only=True)
class AgentSpec:
    """What an agent is made for."""

    image_size: int  # side of the square pictures that it acts on, in pixels
    num_stacked: int  # number of latest pictures that it sees
    num_keypoints: int
    num_states: int
    num_positions: int  # the first numbers of the states
    num_actions: int
    max_delay_steps: int = 0  # steps by which actions may be late; states end with as many actions
    image_noise: ImageNoise | None = None  # of the real camera, absent in simulated pictures
    privileged: np.ndarray  # (N,) bool: parameters that may be used wherever the state may be
    total_steps: int  # of the whole training, for schedules
    steps_before_trial: int  # before its first trial in the real world
    steps_between_updates: int
    seed: int
    device: torch.device | str


@dataclass(frozen=True)
class Observation:
    """What is observed of n simulated worlds at one moment."""

    # (n, D): F features, then the latest actions that are still under way, newest first
    state: np.ndarray
    frames: np.ndarray | None  # (n, K, H, W, 3) uint8, the newest last; None: not drawn


class Agent(Protocol):
    """Actions are in [−1, 1], one row per world. The real world only calls `act`."""

    device: torch.device  # of its networks, and of the replay that it learns from
    needs_keypoints: bool  # whether it learns from keypoints of filmed episodes, too

    @property
    def wants_frames(self) -> bool:
        """Whether to film the next simulated episodes, since drawing is what costs time."""
        ...

    @property
    def can_act(self) -> bool:
        """Whether it has begun to learn to act on frames, and can be tried in reality."""
        ...

    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """(n, K, H, W, 3) uint8 frames to (n, A) actions: the best, or drawn from the policy.

        Called once a step for the same n worlds after `begin_episodes`, so an agent may remember
        them.
        """
        ...

    def begin_episodes(self) -> None:
        """Forget earlier steps: the next `act` is the first one of its episodes.

        A picture alone may not show that: an episode may end in the picture that the next one
        begins with.
        """
        ...

    def explore(self, observation: Observation, replay: ReplayBuffer) -> np.ndarray:
        """(n, A) actions in simulated worlds, to learn from; it may learn from earlier ones."""
        ...

    def update(self, replay: ReplayBuffer, num_steps: int) -> dict[str, float]:
        """Note `num_steps` newly collected steps; losses to be logged, always the same keys.

        The agent decides on the number of updates, and whether they are done here or while it
        explores next.
        """
        ...

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint must hold besides `state`: weights, targets, moments."""
        ...

    def state(self) -> dict[str, Any]:
        """JSON, with states of random generators."""
        ...

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Continue from a checkpoint as if there had been no break.

        Raises InputError for a checkpoint of other networks.
        """
        ...
