"""What a run says of one parameter."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What a run says of a parameter; all numbers are in its unit."""

    name: str
    unit: str  # "1": a pure number; "×": a factor on the nominal values
    nominal: float  # in the model as it was
    initial: float  # where the search began
    mean: float  # the estimate
    low: float  # ends of the 90 % interval
    high: float
    interval_share: float | None  # the interval's part of the range that was searched first
    verdict: str  # by that part: identified, weak, not identifiable
    real: float | None  # the truth, of a pseudo-real world
    percent_error: float | None

    @classmethod
    def read(cls, name: str, facts: Mapping[str, Any]) -> "Estimate":
        """From what result.json says of it; what is not there is None."""
        names = [field.name for field in fields(cls)]
        known: dict[str, Any] = dict.fromkeys(names) | {**facts, "name": name}
        return cls(**{key: known[key] for key in names})
