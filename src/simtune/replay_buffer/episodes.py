"""Simulated episodes, as they are added to a store."""

from dataclasses import dataclass, replace

import numpy as np

from simtune.simulation import Rollouts


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """n simulated episodes of at most T steps, each in its own world.

    After an episode's `lengths` steps values are arbitrary, and nothing learns from them. Rewards
    are 0 there, since a return is the sum of all T (see `rollout._charge_failures`).
    """

    parameters: np.ndarray  # (n, N) of each episode's world, in their units
    full_states: np.ndarray  # (n, T + 1, S) float64, from which frames can be drawn again
    # (n, T + 1, D) float32: F features, then the latest actions that are still under way, newest
    # first
    states: np.ndarray
    actions: np.ndarray  # (n, T, A) float32 in [−1, 1]
    rewards: np.ndarray  # (n, T) float32
    lengths: np.ndarray  # (n,) int, number of valid steps: less than T if the physics diverged
    terminated: np.ndarray  # (n,) bool: the last step ended the task; a time limit does not
    frames: np.ndarray | None = None  # (n, T + 1, H, W, 3) uint8; None: not drawn
    keypoints: np.ndarray | None = None  # (n, T + 1, L, 2) float32 pixels in the frames
    stray: np.ndarray | None = None  # (n, 6) `StrayLight` of the worlds, in the frames
    reached: np.ndarray | None = None  # (n, G) bool, whether each goal is reached at the end

    def __post_init__(self) -> None:
        if self.rewards.ndim != 2:
            raise ValueError(f"rewards must be (n, T), got {self.rewards.shape}")
        n, num_steps = self.rewards.shape
        expected = {
            "parameters": (n, "N"),
            "full_states": (n, num_steps + 1, "S"),
            "states": (n, num_steps + 1, "D"),
            "actions": (n, num_steps, "A"),
            "lengths": (n,),
            "terminated": (n,),
            "frames": (n, num_steps + 1, "H", "W", 3),
            "keypoints": (n, num_steps + 1, "L", 2),
            "stray": (n, 6),
            "reached": (n, "G"),
        }
        for name, shape in expected.items():
            array = getattr(self, name)
            if array is not None and not _fits(array.shape, shape):
                wanted = ", ".join(map(str, shape))
                raise ValueError(
                    f"rewards of {n} episodes of {num_steps} steps go with {name} of shape "
                    f"({wanted}), got {array.shape}"
                )
        if self.frames is not None and self.frames.dtype != np.uint8:
            raise ValueError(f"frames must be uint8, got {self.frames.dtype}")
        if n and not 0 <= self.lengths.min() <= self.lengths.max() <= num_steps:
            raise ValueError(f"lengths must lie in [0, {num_steps}], got {self.lengths}")

    def __len__(self) -> int:
        return len(self.lengths)

    def take(self, index: np.ndarray) -> "Episodes":
        """The episodes at `index` (m,); no copy is made if it selects all."""
        if np.array_equal(index, np.arange(len(self))):
            return self
        return replace(self, **{k: a[index] for k, a in vars(self).items() if a is not None})

    @classmethod
    def unrewarded(
        cls,
        rollouts: Rollouts,
        action_scale: np.ndarray,
        frames: np.ndarray,
        readings: np.ndarray,
    ) -> "Episodes":
        """Filmed rollouts, for an SPM: rewards are 0, and states are the readings.

        `action_scale` (A,) is the largest magnitude of each action; `readings`: (n, T + 1, R).
        """
        n, num_steps, _ = rollouts.actions.shape
        return cls(
            parameters=rollouts.parameters,
            full_states=rollouts.states,
            states=readings.astype(np.float32),
            actions=rollouts.actions / action_scale,
            rewards=np.zeros((n, num_steps), np.float32),
            lengths=np.full(n, num_steps),
            terminated=np.zeros(n, bool),
            frames=frames,
        )


def _fits(shape: tuple[int, ...], expected: tuple[int | str, ...]) -> bool:
    """Whether a shape is as expected; letters stand for any size."""
    pairs = zip(shape, expected, strict=False)
    return len(shape) == len(expected) and all(isinstance(e, str) or s == e for s, e in pairs)
