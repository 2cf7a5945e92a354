"""Common base of agents that learn from pixels alone: when they learn, what is saved."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
import torch

from simtune.agents.agent import Observation
from simtune.agents.noise import uniform_actions
from simtune.agents.saving import Stateful, gather_tensors, scatter_tensors
from simtune.replay import Replay, Transitions, in_parts

_AT_ONCE = 8  # batches drawn; each takes some 20 MB


@dataclass(frozen=True, kw_only=True)
class PixelAgentConfig:
    """Settings common to these agents."""

    num_stacked: int = 3
    hidden_size: int = 1024
    batch_size: int  # transitions per update
    random_steps: int  # before the first update
    update_every: int  # steps
    discount: float = 0.99
    critic_rate: float = 0.01  # τ of the critics' target


@dataclass(kw_only=True)
class Counter:
    """An agent's progress. Steps are those of all worlds together.

    The first `random_steps` have random actions; after them an update is due every `update_every`.
    """

    random_steps: int
    update_every: int
    num_explored: int = 0
    num_collected: int = 0
    num_updates: int = 0

    def explore(self, num_worlds: int) -> bool:
        """Count a step in each world; whether its action is random."""
        is_random = self.num_explored < self.random_steps
        self.num_explored += num_worlds
        return is_random

    def collect(self, num_steps: int) -> int:
        """Count new steps; the number of updates due for them."""
        before = self._num_due()
        self.num_collected += num_steps
        return self._num_due() - before

    def _num_due(self) -> int:
        return max(self.num_collected - self.random_steps, 0) // self.update_every


class PixelAgent(ABC):
    """An `Agent` that only gets frames. A replay must be on its device."""

    wants_frames = True
    losses: ClassVar[tuple[str, ...]]  # names of the outputs of `learn`

    def __init__(
        self, num_actions: int, config: PixelAgentConfig, seed: int, device: torch.device | str
    ):
        self.num_actions, self._batch_size = num_actions, config.batch_size
        self.device = torch.device(device)
        self._generator = torch.Generator(self.device).manual_seed(seed)
        self._counter = Counter(random_steps=config.random_steps, update_every=config.update_every)

    @property
    def can_act(self) -> bool:
        """Whether updates have begun."""
        return self._counter.num_collected > self._counter.random_steps

    @abstractmethod
    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """(n, K, H, W, 3) uint8 to (n, A) actions: the best, or as it explores."""

    @abstractmethod
    def learn(self, batch: Transitions) -> torch.Tensor:
        """One update; its `losses`, NaN for those not computed."""

    @abstractmethod
    def _stateful(self) -> Stateful:
        """All that a checkpoint must hold."""

    def explore(self, observation: Observation) -> np.ndarray:
        """As `act` samples, after the first `random_steps` of all worlds together."""
        frames = observation.frames
        assert frames is not None
        if not self._counter.explore(len(frames)):
            return self.act(frames, sample=True)
        return uniform_actions(len(frames), self.num_actions, self._generator).cpu().numpy()

    def update(self, replay: Replay, num_steps: int) -> dict[str, float]:
        """All updates due for the steps; means of the losses, NaN without any."""
        losses = torch.full((1, len(self.losses)), math.nan)
        if due := self._counter.collect(num_steps):
            losses = torch.stack([self.learn(batch) for batch in self._batches(replay, due)])
        return dict(zip(self.losses, losses.nanmean(0).tolist(), strict=True))

    def _batches(self, replay: Replay, num: int) -> Iterator[Transitions]:
        """On a GPU drawn a few at once, since a draw takes the host a third of an update's time."""
        at_once = 1 if self.device.type == "cpu" else _AT_ONCE
        for several in in_parts(num, at_once):
            size = several * self._batch_size
            yield from replay.sample(size, self._generator, True).split(self._batch_size)

    def tensors(self) -> dict[str, torch.Tensor]:
        """See `Agent`."""
        return gather_tensors(self._stateful(), self._generator)

    def state(self) -> dict[str, Any]:
        """See `Agent`."""
        return asdict(self._counter)

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """See `Agent`."""
        scatter_tensors(self._stateful(), self._generator, tensors)
        self._counter = Counter(**state)
