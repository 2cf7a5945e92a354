"""Observations and actions of several episodes: the data of a fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from simtune.fit.lateness import Lateness
from simtune.observation import AllEvidence
from simtune.trajectory import delayed

_FEWEST_TO_FIT = 2


@dataclass(frozen=True)
class Observed:
    """E episodes of T steps."""

    evidence: AllEvidence  # with leading axes (E, T + 1)
    actions: np.ndarray  # (E, T, A)
    frames: Sequence[np.ndarray] = ()  # E times (T + 1, H, W, 3) uint8, if appearance is fitted
    lateness: Lateness | None = None  # of pictures and of readings, if it is unknown

    def __len__(self) -> int:
        return len(self.actions)

    def episodes(self, which: slice) -> "Observed":
        return replace(
            self,
            evidence=self.evidence.at(which),
            actions=self.actions[which],
            frames=self.frames[which],
        )

    def delayed(self, steps: int) -> "Observed":
        """The same episodes with the actions delayed by `steps`."""
        return replace(self, actions=delayed(self.actions, steps))


class Split(NamedTuple):
    """All episodes but the last are fitted, if these are two or more; the last is a test."""

    fitted: slice
    tested: slice  # the one held out; all, if there is none
    held_out: int | None  # its index

    @classmethod
    def of(cls, num_episodes: int) -> "Split":
        if num_episodes <= _FEWEST_TO_FIT:
            return cls(slice(num_episodes), slice(num_episodes), None)
        last = num_episodes - 1
        return cls(slice(last), slice(last, num_episodes), last)

    @property
    def num_fitted(self) -> int:
        """Number of fitted episodes."""
        return self.fitted.stop
