"""A doubt about one joint's readings or commands, and one sentence for all with the same one."""

from collections.abc import Iterable
from typing import NamedTuple

from simtune.columns import cut

_MOST_NAMED = 12  # joints: a robot's legs, as which columns were exchanged has to be seen


class Doubt(NamedTuple):
    says: str  # a sentence
    kind: str  # the same for the same diagnosis
    likewise: str  # what names this joint in the sentence of another one
    partner: str = ""  # the joint whose column this one's may be


def grouped(doubts: Iterable[Doubt]) -> list[str]:
    """A sentence for each kind: that of its first joint, and the other joints' names."""
    kinds: dict[str, list[Doubt]] = {}
    for doubt in doubts:
        kinds.setdefault(doubt.kind, []).append(doubt)
    return [_together(*alike) for alike in kinds.values()]


def _together(first: Doubt, *others: Doubt) -> str:
    named = cut([doubt.likewise for doubt in others], _MOST_NAMED)
    return f"{first.says} (likewise {named})" if others else first.says
