"""Earlier rounds, for a round that has little time."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import simtune
from simtune.errors import InputError
from simtune.fit import Refits
from simtune.tuning.estimate import Estimate

_MIN_NEW_REFITS = 2  # they count more than any number of earlier rounds'


@dataclass(frozen=True)
class EarlierRounds:
    """What they concluded, also those of an earlier session."""

    refits: Refits | None = None  # None: no known world was fitted
    estimate: Estimate | None = None  # None: nothing was fitted

    def refits_to_trust(self, made: Refits) -> Refits:
        """The refits to judge by: those just `made`, or an earlier round's, if it had more time."""
        before = self.refits
        if before is None or len(made.misfits) >= min(_MIN_NEW_REFITS, len(before.misfits)):
            return made
        return before

    def with_doubts(self, estimate: Estimate) -> "EarlierRounds":
        """With the last round's estimate as it was doubted in the end, if something was fitted."""
        return self if self.estimate is None else replace(self, estimate=estimate)

    def to_json(self) -> dict[str, Any]:
        """As a checkpoint holds it."""
        parts = {"refits": self.refits, "estimate": self.estimate}
        return {name: part and part.to_json() for name, part in parts.items()}

    @classmethod
    def from_json(cls, saved: Mapping[str, Any]) -> "EarlierRounds":
        """The inverse of `to_json`. Raises InputError for other fields, of another version."""
        if others := sorted(saved.keys() ^ cls().to_json().keys()):
            raise InputError(
                f"the checkpoint's earlier rounds are of an older version, and simtune "
                f"{simtune.__version__} has other fields ({', '.join(others)}): go on with the "
                "former version, or start anew"
            )
        refits, estimate = saved["refits"], saved["estimate"]
        return cls(refits and Refits.from_json(refits), estimate and Estimate.from_json(estimate))
