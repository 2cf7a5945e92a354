"""Sentences on recorded steps that are not used."""

from collections.abc import Mapping, Sequence

from simtune.columns import counted, episode_in_words
from simtune.recordings.choosing import leave_out_option

_MOST_LEFT_OUT = 5  # episodes that may be advised to leave out


def of_lengths(
    lengths: Sequence[int], names: Sequence[str], left_out: Sequence[str] = ()
) -> list[str]:
    """On episodes of these numbers of steps, and with these names, all cut to the shortest.

    `left_out`: names of those that are left out already.
    """
    order = sorted(range(len(lengths)), key=lambda episode: lengths[episode])
    unused = sum(lengths) - (used := len(lengths) * min(lengths))
    if not unused:
        return []
    shortest = episode_in_words(names, order[0]).rstrip(",")
    most = max(1, min(_MOST_LEFT_OUT, len(lengths) // 2))
    wins = [(len(lengths) - num) * lengths[order[num]] - used for num in range(1, most + 1)]
    num = 1 + wins.index(max(wins))
    without = "without it" if num == 1 else f"without the {num} shortest"
    option = ""
    if names:
        option = f" ({leave_out_option([*left_out, *(names[i] for i in order[:num])])})"
    advice = f"{without}{option}, {max(wins)} more would be used"
    return [
        f"episodes last {min(lengths)} to {max(lengths)} steps: all are cut to the shortest, "
        f"{shortest}, and {unused} of {sum(lengths)} steps are not used; "
        + (advice if max(wins) > 0 else "without it, no more would be used")
    ]


def of_unfilmed(unfilmed: Mapping[str, int]) -> list[str]:
    """On episodes whose videos have no frame for the last rows, {episode: their number}."""
    if not unfilmed:
        return []
    name, num = max(unfilmed.items(), key=lambda item: item[1])
    others = f", and so are those of {counted(len(unfilmed) - 1, 'other episode')}"
    rows = f"the last {counted(num, 'row')}" if num > 1 else "the last row"
    return [f"{name}: its video has no frame for {rows}: left out" + others * (len(unfilmed) > 1)]
