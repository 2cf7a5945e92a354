"""Segments of episodes, each replayed from an initial state of its own (multiple shooting)."""

from typing import NamedTuple

import numpy as np

from simtune.fit.motion.windows import window_starts
from simtune.fit.readings.stretches import Readings

FEWEST_STEPS = 8


class Segments(NamedTuple):
    """Where W segments of episodes lie."""

    episode: np.ndarray  # (W,)
    begin: np.ndarray  # (W,) row of the first reading
    steps: np.ndarray  # (W,) 0: not compared with readings

    @classmethod
    def evenly(
        cls, readings: Readings, steps: int | None = None, at_most: int | None = None
    ) -> "Segments":
        """Of `steps` steps, by default whole episodes, that begin with a reading.

        `at_most`: limit on their number, spread evenly.
        """
        num_steps = readings.actions.shape[1]
        length = num_steps if steps is None else min(steps, num_steps)
        episode, begin = window_starts(may_begin(readings), length, at_most)
        return cls(episode, begin, np.full(len(begin), length))

    @classmethod
    def joined(cls, some: list["Segments"]) -> "Segments":
        """All of them, in order of time."""
        both = cls(*(np.concatenate(parts) for parts in zip(*some, strict=True)))
        return both.of(np.lexsort((both.begin, both.episode)))

    def or_whole(self, readings: Readings) -> "Segments":
        """These, or whole episodes if none of these is compared with readings."""
        return self if self.steps.any() else Segments.evenly(readings)

    def are(self, others: "Segments") -> bool:
        """Whether these are the same."""
        return all(map(np.array_equal, self, others))

    def of(self, chosen: np.ndarray) -> "Segments":
        """Those that (W,) bool or indices choose."""
        return Segments(*(part[chosen] for part in self))


def steps_until_next(episode: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """(W,) steps to the next of these segments of the same episode, in order of time; 0: none."""
    is_next = np.append(episode[1:] == episode[:-1], False)
    return np.where(is_next, np.roll(begin, -1) - begin, 0)


def may_begin(readings: Readings) -> np.ndarray:
    """(E, T + 1) bool: rows with a reading, and each episode's first, or it would be lost."""
    is_read = np.asarray(np.isfinite(readings.values).any(-1))
    is_read[:, 0] = True
    return is_read
