"""Segments of episodes, each replayed from an initial state of its own (multiple shooting)."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

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
        """Of `steps` steps, by default whole episodes, that begin where one `may_begin`.

        `at_most`: limit on their number, spread evenly.
        """
        num_steps = readings.actions.shape[1]
        length = num_steps if steps is None else min(steps, num_steps)
        episode, begin = _one_after_the_other(may_begin(readings), length)
        if at_most is not None and len(episode) > at_most:
            kept = np.linspace(0, len(episode) - 1, at_most).round().astype(int)
            episode, begin = episode[kept], begin[kept]
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
    """(E, T + 1) bool: rows with all readings that an episode has, and each episode's first.

    Where there is no such row near by, those with any reading: the other joints are guessed there.
    """
    known = np.isfinite(readings.values)
    is_any = np.asarray(known.any(-1))
    is_all = is_any & (known | ~known.any(1, keepdims=True)).all(-1)
    width = 2 * FEWEST_STEPS + 1
    is_near = np.asarray(maximum_filter1d(is_all, width, axis=1, mode="constant"), bool)
    may = is_all | (is_any & ~is_near)
    may[:, 0] = True  # or the episode would be lost
    return may


def _one_after_the_other(may: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray]:
    """(W,) episodes and (W,) first rows of segments of `length` steps, each as soon as it may.

    `may`: (E, T + 1) bool, of which each episode's first row is one.
    """
    num_rows = may.shape[1]
    rows = np.where(may, np.arange(num_rows), num_rows)
    following = np.minimum.accumulate(rows[:, ::-1], 1)[:, ::-1]
    episode, begin = np.arange(len(may)), np.zeros(len(may), int)
    found = list[np.ndarray]()
    while len(episode):
        found.append(np.stack([episode, begin]))
        then = np.minimum(begin + length, num_rows - 1)
        begin = following[episode, then]
        fits = begin + length < num_rows
        episode, begin = episode[fits], begin[fits]
    episode, begin = np.concatenate(found, 1)
    in_order = np.lexsort((begin, episode))
    return episode[in_order], begin[in_order]
