"""D_sp, the simulated episodes that an SPM learns from, and windows of them."""

from dataclasses import dataclass

import numpy as np
import torch

from simtune.replay_buffer import EpisodeStore
from simtune.trajectory import Trajectory


@dataclass(frozen=True)
class Windows:
    """B windows of W consecutive steps; none spans two episodes."""

    frames: torch.Tensor  # (B, W, H, W', 3) uint8
    actions: torch.Tensor  # (B, W, A) float32, in the units of the action space
    readings: torch.Tensor  # (B, W, R) float32 of sensors; NaN where nothing was read

    def __len__(self) -> int:
        return len(self.frames)

    def take(self, which: slice) -> "Windows":
        return Windows(self.frames[which], self.actions[which], self.readings[which])


def split(trajectory: Trajectory, length: int, size: int) -> Windows:
    """All non-overlapping windows of a trajectory, cropped to their central size × size."""
    num_windows = len(trajectory) // length
    steps = num_windows * length
    height, width = trajectory.frames.shape[1:3]
    if num_windows == 0 or min(height, width) < size:
        raise ValueError(
            f"a window is {length} steps of at least {size} × {size} pixels, "
            f"got {len(trajectory)} steps of {height} × {width}"
        )
    top, left = (height - size) // 2, (width - size) // 2
    frames = trajectory.frames[:steps, top : top + size, left : left + size]
    actions = trajectory.actions[:steps].astype(np.float32)
    parts = [read[:steps] for read in trajectory.readings.values()]
    readings = np.hstack([np.empty((steps, 0)), *parts]).astype(np.float32)
    return Windows(
        torch.as_tensor(frames.reshape(num_windows, length, size, size, 3)),
        torch.as_tensor(actions.reshape(num_windows, length, -1)),
        torch.as_tensor(readings.reshape(num_windows, length, readings.shape[1])),
    )


class SpmBuffer:
    """Windows of the filmed episodes in a store."""

    def __init__(self, store: EpisodeStore, action_scale: np.ndarray):
        self.store = store
        # (A,) largest magnitude of each action, which the store scaled to 1
        self._action_scale = torch.as_tensor(action_scale, dtype=torch.float32, device=store.device)

    def sample(
        self, num: int, length: int, size: int, rng: np.random.Generator
    ) -> tuple[Windows, np.ndarray]:
        """One random window from each of `num` random episodes, and their (num, N) parameters.

        All frames of a window get the same random crop (RAD); only the window is copied.
        """
        store = self.store
        lengths = store.lengths[: store.filmed_capacity].numpy()
        usable = np.flatnonzero(lengths >= length)
        if not len(usable):
            raise ValueError(f"no filmed episode of at least {length} steps is stored; add some")
        episodes = rng.choice(usable, num)
        starts = rng.integers(lengths[episodes] - length + 1)
        corners = rng.integers(store.frames.shape[2] - size + 1, size=(num, 2))
        places = list(zip(episodes, starts, corners, strict=True))
        frames = [
            store.frames[e, t : t + length, y : y + size, x : x + size] for e, t, (y, x) in places
        ]
        actions = torch.stack([store.actions[e, t : t + length] for e, t, _ in places])
        readings = torch.stack([store.states[e, t : t + length] for e, t, _ in places])
        windows = Windows(torch.stack(frames), actions * self._action_scale, readings)
        return windows, store.parameters[episodes].numpy()
