"""Common base of agents that learn from pixels alone: when they learn, what is saved."""

import math
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import torch

from simtune.agents.agent import Observation
from simtune.agents.noise import uniform_actions
from simtune.agents.saving import Stateful, gather_tensors, scatter_tensors
from simtune.networks.cuda_graph import Step, graphed
from simtune.replay_buffer import ReplayBuffer, Transitions


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
    num_due: int = 0  # updates that are still to be done

    def explore(self, num_worlds: int) -> bool:
        """Count a step in each world; whether its action is random."""
        is_random = self.num_explored < self.random_steps
        self.num_explored += num_worlds
        return is_random

    def collect(self, num_steps: int) -> None:
        """Count new steps, and the updates due for them."""
        before = self._num_earned()
        self.num_collected += num_steps
        self.num_due += self._num_earned() - before

    def beside(self, num_worlds: int) -> int:
        """How many updates go with a step in each world: those due end with the episode."""
        return min(self.num_due, -(-num_worlds // self.update_every))

    def update(self) -> None:
        """Count an update."""
        self.num_updates += 1
        self.num_due = max(0, self.num_due - 1)

    def _num_earned(self) -> int:
        return max(self.num_collected - self.random_steps, 0) // self.update_every


class PixelAgent(ABC):
    """An `Agent` that only gets frames. A replay must be on its device.

    Updates due for an episode are done step by step during the next one: after an action is known,
    so that a GPU learns while the CPU simulates. Those due for a training's last episode are not.
    """

    wants_frames = True
    needs_keypoints = False
    losses: ClassVar[tuple[str, ...]]  # names of the outputs of `learn`

    def __init__(
        self,
        num_actions: int,
        config: PixelAgentConfig,
        seed: int,
        device: torch.device | str,
        use_graphs: bool,
    ):
        """`use_graphs`: on CUDA updates and acting are captured as graphs, which is faster."""
        self.num_actions, self._batch_size = num_actions, config.batch_size
        self.device = torch.device(device)
        self._generator = torch.Generator(self.device).manual_seed(seed)
        self._counter = Counter(random_steps=config.random_steps, update_every=config.update_every)
        self._use_graphs = use_graphs
        self._adam = partial(torch.optim.Adam, fused=True, capturable=self.device.type == "cuda")
        self._replay: ReplayBuffer | None = None  # that captured updates draw from
        self._losses: list[torch.Tensor] = []  # of the updates since the last log
        self._begin_steps()

    @property
    def can_act(self) -> bool:
        """Whether updates have begun."""
        return self._counter.num_updates > 0

    def act(self, frames: np.ndarray, sample: bool = False) -> np.ndarray:
        """(n, K, H, W, 3) uint8 to (n, A) actions: the best, or as it explores."""
        kind = len(frames), sample
        if kind not in self._acting:
            self._acting[kind] = self._graphed(partial(self._act, sample=sample))
        return self._acting[kind](torch.as_tensor(frames).to(self.device)).cpu().numpy()

    def begin_episodes(self) -> None:  # noqa: B027
        """See `Agent`; nothing is remembered."""

    @abstractmethod
    def _act(self, frames: torch.Tensor, sample: bool) -> torch.Tensor:
        """`act` on its device."""

    @abstractmethod
    def learn(self, batch: Transitions, updates_policy: bool = True) -> torch.Tensor:
        """One update of the critics, and of the policy if it `updates_policy`.

        Returns its `losses`, NaN for those not computed.
        """

    @property
    def _updates_policy(self) -> bool:
        """Whether the next update is of the policy and the targets, too, not of critics alone."""
        return True

    @abstractmethod
    def _stateful(self) -> Stateful:
        """All that a checkpoint must hold."""

    def explore(self, observation: Observation, replay: ReplayBuffer) -> np.ndarray:
        """As `act` samples, after the first `random_steps` of all worlds together."""
        frames = observation.frames
        assert frames is not None
        if self._counter.explore(len(frames)):
            drawn = uniform_actions(len(frames), self.num_actions, self._generator)
            actions = drawn.cpu().numpy()
        else:
            actions = self.act(frames, sample=True)
        self._update(replay, self._counter.beside(len(frames)))
        return actions

    def update(self, replay: ReplayBuffer, num_steps: int) -> dict[str, float]:
        """See `Agent`; means of losses, NaN without any."""
        self._update(replay, self._counter.num_due)  # usually none is left
        self._counter.collect(num_steps)
        losses = torch.stack(self._losses or [torch.full((len(self.losses),), math.nan)])
        self._losses = []
        return dict(zip(self.losses, losses.nanmean(0).tolist(), strict=True))

    def _update(self, replay: ReplayBuffer, num: int) -> None:
        """Updates on batches of the replay, which the host does not wait for on a GPU.

        None while no filmed step is stored.
        """
        if not replay.num_filmed_steps:
            return
        if replay is not self._replay:
            self._replay = replay
            self._begin_steps()
        for _ in range(num):
            loss = self._steps[self._updates_policy]()
            self._losses.append(loss.clone())  # a graph reuses its output's memory
            self._counter.update()

    def _learn_drawn(self, updates_policy: bool) -> torch.Tensor:
        assert self._replay is not None
        batch = self._replay.sample(self._batch_size, self._generator, with_frames=True)
        return self.learn(batch, updates_policy)

    def _begin_steps(self) -> None:
        """Make anew what is captured as graphs, which hold the weights' and moments' memory."""
        self._steps = {
            updates_policy: self._graphed(partial(self._learn_drawn, updates_policy))
            for updates_policy in (False, True)
        }
        self._acting: dict[tuple[int, bool], Step] = {}  # by the number of worlds, and sampling

    def _graphed(self, step: Step) -> Step:
        return graphed(step, self._generator) if self._use_graphs else step

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
        self._losses = []
        self._begin_steps()
