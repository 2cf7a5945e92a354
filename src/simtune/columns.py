"""Plain text: columns, lists that are cut short, numbers, and numbers of things."""

from collections.abc import Collection, Sequence


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
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


def episode_in_words(names: Sequence[str], index: int) -> str:
    """How a message calls an episode: as recordings do, or by its number if there are no names."""
    return names[index] if names else f"episode {index}, counted from 0,"
