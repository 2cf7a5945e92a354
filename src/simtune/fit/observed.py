"""Observations and actions of several episodes: the data of a fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.fit.lateness import Lateness
from simtune.observation import AllEvidence
from simtune.trajectory import delayed


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
