"""Plots of simulation-based calibration: ranks of the truth in fits of known worlds.

A rank is the probability that a fit assigned to values below the truth. If intervals can be
trusted, ranks are uniform; with too narrow intervals, they pile up at both ends.
"""

import numpy as np
from scipy.special import bdtr

from simtune.report.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Axis, Plot

ENOUGH_WORLDS = 5  # fewer say little of intervals
_BINS = 10
_MOST_ROWS = 40  # of parameters; more would not be readable
_ROW = 15  # pixels
_NAMES = 120  # pixels on the left, for the parameters' names
_MOST_LETTERS = 19  # of a name
_LABELS = {0: "0", 0.5: "0.5", 1: "1"}


def rank_histogram(ranks: list[float]) -> Plot:
    """Histogram of ranks in ten bins, with the expected range of counts."""
    counts = np.histogram(ranks, _BINS, (0, 1))[0]
    low, high = expected(len(ranks))
    x = Axis(0, 1, LEFT + 4, WIDTH - RIGHT - 4)
    y = Axis(0, float(max(counts.max(), high)) * 1.08, HEIGHT - BOTTOM, TOP)
    plot = Plot("histogram of where the truth lay in known worlds", x, y)
    plot.label_y([tick for tick in y.ticks(4) if tick == round(tick)])
    plot.label_x(_LABELS, "where the truth lay")
    for i, count in enumerate(counts):
        start, end = i / _BINS, (i + 1) / _BINS
        title = f"{start:g} to {end:g}: {count} of {len(ranks)}"
        plot.box((start, count), (end, 0), "bar", title, inset=1)
    # Drawn over the bars, which would hide it.
    plot.box((0, high), (1, low), "expected")
    return plot


def expected(num: int) -> tuple[int, int]:
    """5 % and 95 % quantiles of the count in one of ten bins, for `num` uniform ranks."""
    below = bdtr(np.arange(num + 1), num, 1 / _BINS)
    low, high = np.searchsorted(below, (0.05, 0.95))
    return int(low), int(high)


def rank_dots(ranks: dict[str, list[float]]) -> Plot | None:
    """One row per parameter, one dot per rank; None if there are too many parameters."""
    if len(ranks) > _MOST_ROWS:
        return None
    width = WIDTH + _NAMES - LEFT
    x = Axis(0, 1, _NAMES, width - 8)
    y = Axis(0, len(ranks), TOP, TOP + _ROW * len(ranks))
    plot = Plot("where the truth lay in known worlds, a row a parameter", x, y, width)
    plot.box((0.05, 0), (0.95, len(ranks)), "range")
    for i, (name, given) in enumerate(ranks.items()):
        middle = i + 0.5
        plot.label(_NAMES - 8, y(middle) + 3.5, _shortened(name), "end")
        plot.line([(0, middle), (1, middle)], "grid")
        for rank in given:
            plot.dot((rank, middle), "rank", f"{name}: {rank:.2f}")
    plot.label_x(_LABELS, "where the truth lay")
    return plot


def _shortened(name: str) -> str:
    return name if len(name) <= _MOST_LETTERS else f"{name[: _MOST_LETTERS - 1]}…"
