"""What agents that learn from pixels alone have in common: when they learn, what is saved."""

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Protocol

import numpy as np
import torch

from simtune.agents.agent import Observation
from simtune.agents.counting import Counter
from simtune.agents.noise import uniform_actions
from simtune.agents.saving import Stateful, gather_tensors, scatter_tensors
from simtune.replay import Replay, Transitions


class Learning(Protocol):
    """Those of an agent's settings that say when it learns, and from how much at once."""

    @property
    def batch_size(self) -> int:
        """Transitions of an update."""
        ...

    @property
    def random_steps(self) -> int:
        """Before the first update."""
        ...

    @property
    def update_every(self) -> int:
        """Steps."""
        ...


class PixelAgent(ABC):
    """An `Agent` that gets nothing but frames. A replay has to lie on its device."""

    wants_frames = True
    losses: ClassVar[tuple[str, ...]]  # names of what `learn` returns

    def __init__(self, num_actions: int, learning: Learning, seed: int, device: torch.device | str):
        self.num_actions, self._batch_size = num_actions, learning.batch_size
        self.device = torch.device(device)
        self._generator = torch.Generator(self.device).manual_seed(seed)
        self._counter = Counter(
            random_steps=learning.random_steps, update_every=learning.update_every
        )

    @property
    def can_act(self) -> bool:
        """Whether updates have begun."""
        return self._counter.num_collected > self._counter.random_steps

    @abstractmethod
    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """(n, K, H, W, 3) uint8 to (n, A) actions: the best, or as it explores."""

    @abstractmethod
    def learn(self, batch: Transitions) -> torch.Tensor:
        """One update; its `losses`, NaN where it had none."""

    @abstractmethod
    def _stateful(self) -> Stateful:
        """All that a checkpoint has to hold."""

    def explore(self, observation: Observation) -> np.ndarray:
        """As `act` samples, after the first `random_steps` of all worlds together."""
        frames = observation.frames
        assert frames is not None
        if not self._counter.explore(len(frames)):
            return self.act(frames, sample=True)
        return uniform_actions(len(frames), self.num_actions, self._generator).cpu().numpy()

    def update(self, replay: Replay, num_steps: int) -> dict[str, float]:
        """All updates that are due for the steps; means of the losses, NaN without any."""
        losses = torch.full((1, len(self.losses)), math.nan)
        if due := self._counter.collect(num_steps):
            losses = torch.stack([self.learn(self._sample(replay)) for _ in range(due)])
        return dict(zip(self.losses, losses.nanmean(0).tolist(), strict=True))

    def _sample(self, replay: Replay) -> Transitions:
        return replay.sample(self._batch_size, self._generator, with_frames=True)

    def tensors(self) -> dict[str, torch.Tensor]:
        """See `Agent`."""
        return gather_tensors(self._stateful(), self._generator)

    def state(self) -> dict[str, Any]:
        """See `Agent`."""
        return self._counter.state()

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """See `Agent`."""
        scatter_tensors(self._stateful(), self._generator, tensors)
        self._counter.load(state)
