"""Readings after the changes that explain them, and what may be meant instead of each change."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from simtune.checking.mistakes.changes import ZERO, Change
from simtune.checking.mistakes.short_replays import ShortReplays
from simtune.fit import Readings


class Found(NamedTuple):
    """Of a change that helps."""

    zero: float  # what was measured of a joint that is at 0, if it changes a zero
    others: list[str]  # what it says, and what another one does that helps as much


@dataclass(frozen=True)
class Explained:
    """Readings (E, T + 1, D) after some changes, and what short replays leave of them."""

    replays: ShortReplays
    readings: Readings
    left: float
    found: Mapping[str, Found] = field(default_factory=dict)  # by what each change says
    scale: np.ndarray | float = 1.0  # (D,) of these readings, in those as they were read

    @cached_property
    def left_at_best_size(self) -> float:
        """What no change of readings has to do with: of actions that do less, or more."""
        return self.replays.left_at_best_size(self.readings, self.left)

    def with_change(self, change: Change, left: float, others: list[str]) -> "Explained":
        """After one more, which leaves so much, and instead of which `others` may be meant.

        A sign that is reversed twice, as two exchanged columns, is as it was.
        """
        found = dict(self.found)
        if change.shift.any():
            before = found[change.says].zero if change.says in found else 0.0
            zero = before - float((change.shift / self.scale).sum())
            found[change.says] = Found(zero, others)
        elif change.says in found:
            del found[change.says]
        else:
            found[change.says] = Found(0.0, others)
        scale = np.broadcast_to(self.scale, change.factor.shape)[change.read] * change.factor
        return Explained(self.replays, change.of(self.readings), left, found, scale)


def in_words(found: Mapping[str, Found]) -> str:
    """Each change by what it says, and what may be meant instead if nothing else says that."""
    told = []
    for says, (zero, others) in found.items():
        instead = [other for other in others if other not in found]
        told.append(", or ".join([says, *instead[:1]]).replace(ZERO, f"{zero:.2f}"))
    return ", and ".join(told)
