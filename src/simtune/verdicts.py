"""What an interval's width says of a parameter: identified, weak, or not identifiable."""

from collections.abc import Iterable, Sequence
from typing import Literal

Verdict = Literal["identified", "weak", "not identifiable"]

# Width of the 90 % interval over the first range for "identified"; ±10 % on a log scale
IDENTIFIED_SHARE = 0.09
WEAK_SHARE = 0.6  # ... and up to here "weak"


def verdict_of(share: float) -> Verdict:
    """The verdict on an interval that is this share of the first range wide."""
    if share <= IDENTIFIED_SHARE:
        return "identified"
    return "weak" if share <= WEAK_SHARE else "not identifiable"


def at_most_weak(
    verdicts: Sequence[Verdict], doubtful: Iterable[bool] | None = None
) -> list[Verdict]:
    """The verdicts, with "identified" replaced by "weak" if `doubtful`, one each; None: all are."""
    doubts = [True] * len(verdicts) if doubtful is None else doubtful
    return [
        "weak" if is_doubtful and verdict == "identified" else verdict
        for verdict, is_doubtful in zip(verdicts, doubts, strict=True)
    ]
