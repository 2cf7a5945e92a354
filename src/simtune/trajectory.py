"""A trajectory: the frames of an episode and the actions between them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np


def moments(last: int | np.ndarray, num: int) -> np.ndarray:
    """(num,) steps from 0 to `last`, equally spaced and rounded down; (E, num) for (E, 1) lasts."""
    return (np.linspace(0, 1, num) * last + 1e-9).astype(int)  # more than a product's rounding


def delayed(actions: np.ndarray, steps: int) -> np.ndarray:
    """(..., T, A) actions, `steps` steps later; before, the first one.

    Not zero, which may be far away for a robot with position commands.
    """
    return actions[..., np.maximum(np.arange(actions.shape[-2]) - steps, 0), :]


def seen_late(pixels: np.ndarray, steps: float) -> np.ndarray:
    """(..., T, D) positions in pictures, in those that come `steps` later.

    Interpolated along straight lines, and clamped to the first and the last one. Not for states,
    whose quaternions do not lie on straight lines: see `fit.states_in_late_pictures`.
    """
    if not steps:
        return pixels
    last = pixels.shape[-2] - 1
    at = np.clip(np.arange(last + 1) - steps, 0, last)
    before = np.minimum(at.astype(int), max(last - 1, 0))
    after, share = np.minimum(before + 1, last), (at - before)[:, None]
    return (1 - share) * pixels[..., before, :] + share * pixels[..., after, :]


@dataclass(frozen=True)
class Trajectory:
    """All that the real world gives.

    `frames[t]` was seen, then `actions[t]` was applied for one step of `step_s` seconds, then
    `frames[t + 1]` was seen. Without a camera, frames are empty.
    """

    frames: np.ndarray  # (T + 1, H, W, 3) uint8; (T + 1, 0, 0, 3) without pictures
    actions: np.ndarray  # (T, A) float32, in the units of the action space
    step_s: float
    # {sensor: (T + 1, D)} measured with each frame
    readings: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        frames, actions = self.frames, self.actions
        if frames.dtype != np.uint8 or frames.ndim != 4 or frames.shape[-1] != 3:
            raise ValueError(
                f"frames must be uint8 (T + 1, H, W, 3), got {frames.dtype} {frames.shape}"
            )
        if actions.ndim != 2 or len(actions) != len(frames) - 1:
            raise ValueError(
                f"{len(frames)} frames need actions of shape ({len(frames) - 1}, A), "
                f"got {actions.shape}"
            )
        for name, values in self.readings.items():
            if values.ndim != 2 or len(values) != len(frames):
                raise ValueError(
                    f"{len(frames)} frames go with as many readings of {name}, got {values.shape}"
                )

    def __len__(self) -> int:
        """Number of steps T."""
        return len(self.actions)

    @property
    def has_pictures(self) -> bool:
        return self.frames.size > 0

    def first(self, steps: int) -> "Trajectory":
        """Its first `steps` steps, or all if there are fewer."""
        readings = {name: values[: steps + 1] for name, values in self.readings.items()}
        frames, actions = self.frames[: steps + 1], self.actions[:steps]
        return replace(self, frames=frames, actions=actions, readings=readings)
