"""Segments of episodes, each replayed from an initial state of its own (multiple shooting).

States of whole episodes as readings give them are cut into stretches, one of each segment.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from simtune.fit.readings.readings import Readings, travel

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


class Stretches(NamedTuple):
    """W stretches of K steps."""

    actions: np.ndarray  # (W, K, A)
    values: np.ndarray  # (W, K + 1, D)
    states: np.ndarray  # (W, nq + nv) initial states, as far as readings say
    actuator_states: np.ndarray  # (W, S) with what earlier actions left behind
    episode: np.ndarray  # (W,)
    # (W, 2 nv) derivative of `states` by a lateness's unit coordinate; None: there is no lateness
    drift: np.ndarray | None = None
    begin: np.ndarray | None = None  # (W,) rows of their episodes
    # Whether what is pushed, unmeasured, goes on from the stretch before, in order of time
    goes_on: bool = False

    def of(self, chosen: np.ndarray) -> "Stretches":
        """Those that (W,) bool chooses."""
        return Stretches(
            actions=self.actions[chosen],
            values=self.values[chosen],
            states=self.states[chosen],
            actuator_states=self.actuator_states[chosen],
            episode=self.episode[chosen],
            drift=None if self.drift is None else self.drift[chosen],
            begin=None if self.begin is None else self.begin[chosen],
            goes_on=self.goes_on,
        )

    @property
    def travel(self) -> np.ndarray:
        """(W, D); see `travel`."""
        return travel(self.values)

    @property
    def longest(self) -> int:
        """Steps after which no reading follows, and one more, since a lateness is interpolated."""
        known = np.isfinite(self.values).any((0, 2))
        return min(self.actions.shape[1], 1 + int(np.flatnonzero(known).max(initial=0)))

    def first(self, steps: int) -> "Stretches":
        """The first `steps` steps of each."""
        return self._replace(actions=self.actions[:, :steps], values=self.values[:, : steps + 1])


class ReadStates(NamedTuple):
    """Of E episodes, at each reading."""

    readings: Readings
    states: np.ndarray  # (E, T + 1, nq + nv)
    actuator_states: np.ndarray  # (E, T + 1, S) with what earlier actions left behind
    drift: np.ndarray | None  # (E, T + 1, 2 nv) as in `Stretches`
    of_actions: np.ndarray  # (D,) bool: readings that the action before each row tells

    def cut(self, segments: Segments, goes_on: bool = False) -> Stretches:
        """Stretches of these segments; shorter ones are padded with NaN and later actions.

        `goes_on`: see `Stretches`. Then segments of no steps, which are not compared with readings,
        are played up to the next one.
        """
        actions, values = self.readings.actions, self.readings.values
        episode, begin, steps = segments
        longest = steps.max()
        if goes_on:
            longest = max(longest, steps_until_next(episode, begin).max())
        rows = np.arange(longest + 1)
        frames = np.minimum(begin[:, None] + rows, values.shape[1] - 1)
        acting = np.minimum(frames[:, :-1], actions.shape[1] - 1)
        is_within = ((rows <= steps[:, None]) & (steps[:, None] > 0))[..., None]
        # No action of a segment leads to its first row
        is_told = is_within & ((rows > 0)[:, None] | ~self.of_actions)
        return Stretches(
            actions[episode[:, None], acting],
            np.where(is_told, values[episode[:, None], frames], np.nan),
            self.states[episode, begin],
            self.actuator_states[episode, begin],
            episode,
            None if self.drift is None else self.drift[episode, begin],
            begin,
            goes_on,
        )


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
