"""D_policy: the stored episodes as an agent learns from them, in single steps."""

from dataclasses import dataclass

import torch

from simtune.replay.store import EpisodeStore


@dataclass(frozen=True)
class Transitions:
    """B single steps of simulated worlds, drawn from all stored episodes."""

    states: torch.Tensor  # (B, D) float32 of `Environment.observe`: known in simulation only
    actions: torch.Tensor  # (B, A) float32 in [−1, 1]
    rewards: torch.Tensor  # (B,) float32
    discounts: torch.Tensor  # (B,) float32: 0 where the task ended, 1 where only the time did
    next_states: torch.Tensor  # (B, D)
    parameters: torch.Tensor  # (B, N) float32 of their worlds, as coordinates in [0, 1]
    # (B, K, H, W, 3) uint8, the oldest first; before an episode's first frame that one is repeated
    frames: torch.Tensor | None = None
    next_frames: torch.Tensor | None = None


@dataclass(eq=False, kw_only=True)
class Replay(EpisodeStore):
    """A store whose steps can be sampled, with stacks of the `num_stacked` latest frames."""

    num_stacked: int = 3  # appendix

    def sample(self, batch_size: int, generator: torch.Generator, with_frames: bool) -> Transitions:
        """Steps drawn uniformly from all that are stored, or from those that were filmed.

        `generator` is one of the store's device, which the host does not wait for. `frames` and
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
        """(B, H, W, 3) frames drawn from all stored ones; (B, L, 2) keypoints, (B, D) states."""
        at = self._draw(batch_size, generator, filmed=True)
        return self.frames[at], self.keypoints[at], self.states[at]

    @property
    def stack_offsets(self) -> torch.Tensor:
        """(K,) steps from the newest frame of a stack to each of it."""
        return torch.arange(1 - self.num_stacked, 1, device=self.device)

    def _draw(
        self, num: int, generator: torch.Generator, filmed: bool
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Slots (num,) and steps (num,) within them, uniform over all steps."""
        num_steps = self.num_filmed_steps if filmed else self.num_steps
        if num_steps == 0:
            kind = "filmed episode" if filmed else "episode"
            raise ValueError(f"no {kind} is stored; add some before sampling")
        # Slots with frames come first, and so do their steps. An empty slot has none.
        step = torch.randint(num_steps, (num,), generator=generator, device=self.device)
        episode = torch.searchsorted(self._steps.ends, step, right=True)
        return episode, step - self._steps.starts[episode]

    def _stacks(self, episode: torch.Tensor, t: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, K, H, W, 3) frames up to `t`, and up to `t` + 1; the first one is repeated."""
        num_frames = self.frames.shape[1]
        offsets = torch.arange(1 - self.num_stacked, 2, device=self.device)
        time = (t[:, None] + offsets).clamp(min=0)  # K + 1 of them: both stacks, gathered once
        index = (episode[:, None] * num_frames + time).flatten()
        # On a CPU twice as fast as frames[episode, time].
        seen = self.frames.flatten(0, 1).index_select(0, index).unflatten(0, time.shape)
        return seen[:, :-1], seen[:, 1:]
