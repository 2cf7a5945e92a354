"""Plain text: columns, lists that are cut short, numbers, and numbers of things."""

import math
from collections.abc import Collection, Sequence
from decimal import Decimal

_PLAIN = (1e-5, 1e6)  # sizes that are written without an exponent
_MORE_PLACES = 2  # at most, for the low end of an interval wider than itself


def aligned(rows: Sequence[Sequence[str]], left: Collection[int]) -> list[str]:
    """Lines of cells, padded to their columns' widths; columns in `left` are left-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def cut(items: Sequence[str], most: int, separator: str = ", ") -> str:
    """The first `most` of them, and the number of others: "a, b and 3 more"."""
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return separator.join(items[:most]) + more


def counted(num: int, what: str) -> str:
    """A number with its noun: 1 round, 2 rounds."""
    return f"{num} {what}{'s' * (num != 1)}"


def two_digits(value: float) -> str:
    """A number with two digits, and whole ones with all of theirs: 0.046, 3.2, 140."""
    if abs(value) >= 9.95:
        return f"{value:.0f}"
    text = f"{value:.2g}"
    return f"{Decimal(text):f}" if _is_plain(value) else text


def significant(value: float) -> str:
    """In three digits: 0.0123, 4.57, 1,230, 0.0000210, 2.10e-06."""
    if value == 0:
        return "0"
    if not _is_plain(value):
        return f"{value:.2e}"
    places = 2 - int(f"{value:e}".split("e")[1])
    return f"{round(value, places):,.{max(places, 0)}f}"


def within(value: float, low: float, high: float) -> str:
    """A value in the decimals that an interval warrants: two digits of half its width.

    An estimate, its interval's ends and its truth so have the same decimals; all of them are
    finite. One more or two, if the low end would else look like 0.
    """
    half, largest = abs(high - low) / 2, max(abs(low), abs(high))
    if not half:
        return significant(value)
    if not _is_plain(largest):
        size = _exponent(value) if value else _exponent(largest)
        return f"{value:.{max(size - _exponent(half) + 1, 0)}e}"
    places = max(1 - _exponent(half), 0)
    if low > 0:
        places = min(max(places, -_exponent(low)), places + _MORE_PLACES)
    return f"{round(value, places) + 0.0:,.{places}f}"  # not -0


def _is_plain(value: float) -> bool:
    return value == 0 or _PLAIN[0] <= abs(value) < _PLAIN[1]


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def episode_in_words(names: Sequence[str], index: int) -> str:
    """How a message calls an episode: as recordings do, or by its number if there are no names."""
    return names[index] if names else f"episode {index}, counted from 0,"
