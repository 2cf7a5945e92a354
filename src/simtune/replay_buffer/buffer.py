"""D_policy: the stored episodes, sampled as single steps that an agent learns from."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from simtune.replay_buffer.store import EpisodeStore


@dataclass(frozen=True)
class Transitions:
    """B single steps, drawn from all stored episodes."""

    # (B, D) float32, known in simulation only: F features, then the latest actions that are still
    # under way, newest first
    states: torch.Tensor
    actions: torch.Tensor  # (B, A) float32 in [−1, 1]
    rewards: torch.Tensor  # (B,) float32
    discounts: torch.Tensor  # (B,) float32: 0 if the step ended the task, else 1
    next_states: torch.Tensor  # (B, D)
    parameters: torch.Tensor  # (B, N) float32 of the worlds, as coordinates in [0, 1]
    # (B, K, H, W, 3) uint8, oldest first; an episode's first frame is repeated before its start
    frames: torch.Tensor | None = None
    next_frames: torch.Tensor | None = None

    def split(self, size: int) -> Iterator["Transitions"]:
        """In batches of `size` and a rest; they share memory with these."""
        for start in range(0, len(self.rewards), size):
            part = slice(start, start + size)
            values = {name: value[part] for name, value in vars(self).items() if value is not None}
            yield Transitions(**values)


def in_parts(num_batches: int, at_once: int) -> Iterator[int]:
    """Numbers of batches that are drawn at once, which is faster than one by one."""
    for start in range(0, num_batches, at_once):
        yield min(at_once, num_batches - start)


@dataclass(eq=False, kw_only=True)
class ReplayBuffer(EpisodeStore):
    """A store with sampling of steps and of stacks of the `num_stacked` latest frames."""

    num_stacked: int = 3  # appendix

    def sample(self, batch_size: int, generator: torch.Generator, with_frames: bool) -> Transitions:
        """Steps drawn uniformly from all stored steps, or `with_frames` from filmed ones.

        `generator` must be on the store's device, so that the host need not wait and a CUDA graph
        can draw them, from what is stored when it is replayed. `frames` and
        `next_frames` share memory, so neither may be changed in place.
        """
        episode, t = self._draw(batch_size, generator, with_frames)
        frames, next_frames = self._stacks(episode, t) if with_frames else (None, None)
        return Transitions(
            states=self.states[episode, t],
            actions=self.actions[episode, t],
            rewards=self.rewards[episode, t],
            discounts=(self._steps.starts[episode] + t != self._steps.terminals[episode]).float(),
            next_states=self.states[episode, t + 1],
            parameters=self._steps.coordinates[episode],
            frames=frames,
            next_frames=next_frames,
        )

    def pictures(
        self, batch_size: int, generator: torch.Generator
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """(B, H, W, 3) frames drawn from all stored ones, their keypoints (B, L, 2) and states
        (B, D).
        """
        at = self._draw(batch_size, generator, filmed=True)
        return self.frames[at], self.keypoints[at], self.states[at]

    @property
    def stack_offsets(self) -> torch.Tensor:
        """(K,) steps of a stack's frames relative to the newest: 1 − K to 0."""
        return torch.arange(1 - self.num_stacked, 1, device=self.device)

    def _draw(
        self, num: int, generator: torch.Generator, filmed: bool
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Slots (num,) and steps (num,) within them, uniform over all steps."""
        if not (self.num_filmed_steps if filmed else self.num_steps):
            kind = "filmed episode" if filmed else "episode"
            raise ValueError(f"no {kind} is stored; add some before sampling")
        # Steps of slots with frames come first; an empty slot has no steps. In double precision,
        # or not every step of a large store could be drawn.
        double = {"dtype": torch.float64, "device": self.device}
        share = torch.rand(num, generator=generator, **double)
        step = (share * self._steps.totals[int(filmed)]).long()
        episode = torch.searchsorted(self._steps.ends, step, right=True)
        return episode, step - self._steps.starts[episode]

    def _stacks(self, episode: torch.Tensor, t: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, K, H, W, 3) frames up to `t`, and up to `t` + 1; the first frame is repeated."""
        num_frames = self.frames.shape[1]
        offsets = torch.arange(1 - self.num_stacked, 2, device=self.device)
        time = (t[:, None] + offsets).clamp(min=0)  # (B, K + 1): both stacks are gathered at once
        index = (episode[:, None] * num_frames + time).flatten()
        # Twice as fast on a CPU as frames[episode, time].
        seen = self.frames.flatten(0, 1).index_select(0, index).unflatten(0, time.shape)
        return seen[:, :-1], seen[:, 1:]
