"""What was observed of several episodes, and done in them: what a fit explains."""

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
    frames: Sequence[np.ndarray] = ()  # E times (T + 1, H, W, 3) uint8, where appearance is fitted
    lateness: Lateness | None = None  # of pictures, where it is not known

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
        """The same, had the actions come so much later."""
        return replace(self, actions=delayed(self.actions, steps))
