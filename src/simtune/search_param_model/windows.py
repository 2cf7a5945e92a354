"""D_sp, the simulated episodes that an SPM learns from, and windows of them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simtune.simulation import Rollouts
from simtune.trajectory import Trajectory


@dataclass(frozen=True)
class Windows:
    """B windows of W consecutive steps; none spans two episodes."""

    frames: np.ndarray  # (B, W, H, W', 3) uint8
    actions: np.ndarray  # (B, W, A) float32

    def __len__(self) -> int:
        return len(self.frames)


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
    return Windows(
        frames.reshape(num_windows, length, size, size, 3),
        trajectory.actions[:steps].reshape(num_windows, length, -1),
    )


class SpmBuffer:
    """The latest `capacity` simulated episodes, each frame stored once, as uint8.

    A slot is `num_steps + 1` pictures; its memory is taken when it is first filled.
    """

    def __init__(self, capacity: int, num_steps: int, image_size: int):
        shape = (capacity, num_steps + 1, image_size, image_size, 3)
        self._frames = np.empty(shape, np.uint8)
        self._rollouts: Rollouts | None = None  # as many slots; frames can be drawn from them
        self.num_added = 0

    def __len__(self) -> int:
        return min(self.num_added, len(self._frames))

    @property
    def rollouts(self) -> Rollouts:
        """The stored episodes, slot by slot: enough to draw their frames again."""
        assert self._rollouts is not None, "nothing was added yet"
        stored, n = self._rollouts, len(self)
        return Rollouts(stored.parameters[:n], stored.states[:n], stored.actions[:n])

    def add(self, rollouts: Rollouts, frames: np.ndarray) -> None:
        """Store n episodes and their (n, T + 1, H, W, 3) frames in the place of the oldest."""
        if self._rollouts is None:
            arrays = (rollouts.parameters, rollouts.states, rollouts.actions)
            capacity = len(self._frames)
            self._rollouts = Rollouts(*(np.empty((capacity, *a.shape[1:])) for a in arrays))
        for i in range(len(rollouts)):
            slot = self.num_added % len(self._frames)
            self._frames[slot] = frames[i]
            self._rollouts.parameters[slot] = rollouts.parameters[i]
            self._rollouts.states[slot] = rollouts.states[i]
            self._rollouts.actions[slot] = rollouts.actions[i]
            self.num_added += 1

    def restore(
        self, rollouts: Rollouts, num_added: int, film: Callable[[Rollouts], np.ndarray]
    ) -> None:
        """Put `rollouts` of another buffer into the same slots, their frames drawn anew."""
        self.num_added = 0
        for i in range(0, len(rollouts), 10):  # few at once: pictures are large
            few = slice(i, i + 10)
            part = Rollouts(rollouts.parameters[few], rollouts.states[few], rollouts.actions[few])
            self.add(part, film(part))
        self.num_added = num_added

    def sample(
        self, num: int, length: int, size: int, rng: np.random.Generator
    ) -> tuple[Windows, np.ndarray]:
        """One random window of each of `num` random episodes, and their (num, N) parameters.

        The same random crop for all frames of a window (RAD), and the window alone is copied.
        """
        stored = self.rollouts
        episodes = rng.integers(len(self), size=num)
        starts = rng.integers(stored.actions.shape[1] - length + 1, size=num)
        corners = rng.integers(self._frames.shape[2] - size + 1, size=(num, 2))
        frames = np.empty((num, length, size, size, 3), np.uint8)
        actions = np.empty((num, length, stored.actions.shape[2]), np.float32)
        for i, (e, t, (y, x)) in enumerate(zip(episodes, starts, corners, strict=True)):
            frames[i] = self._frames[e, t : t + length, y : y + size, x : x + size]
            actions[i] = stored.actions[e, t : t + length]
        return Windows(frames, actions), stored.parameters[episodes]
