"""Earlier rounds, for a round that has little time."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from simtune.fit import Refits, lacks_known_worlds
from simtune.tuning.estimate import Estimate, refuse_other_fields

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

    def lacks_refits(self, most: int) -> bool:
        """Whether more time would give more known worlds, of `most`, where these are too few."""
        refits = self.refits
        return refits is None or (lacks_known_worlds(refits) and len(refits.misfits) < most)

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
        others = saved.keys() ^ cls().to_json().keys()
        refuse_other_fields("earlier rounds are of an older version", others)
        refits, estimate = saved["refits"], saved["estimate"]
        return cls(refits and Refits.from_json(refits), estimate and Estimate.from_json(estimate))
