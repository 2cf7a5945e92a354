"""Simulation-based calibration as inline SVG: where in known worlds' fits the truth was.

A rank is the probability that a fit gave to values below the truth. Where intervals can be
trusted, ranks are uniform; too narrow intervals pile them up at both ends.
"""

import numpy as np
from scipy.special import bdtr

from simtune.report.axis import Axis
from simtune.report.svg import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    dot,
    frame,
    label,
    line,
    rectangle,
    svg,
)

_BINS = 10
_MOST_ROWS = 40  # of parameters; more would be no picture any more
_ROW = 15  # pixels
_NAMES = 120  # pixels on the left, for the parameters' names


def rank_histogram(ranks: list[float]) -> str:
    """How many ranks are in each tenth, and how many there should be; "" without any."""
    if not ranks:
        return ""
    counts = np.histogram(ranks, _BINS, (0, 1))[0]
    low, high = expected(len(ranks))
    x = Axis(0, 1, LEFT + 4, WIDTH - RIGHT - 4)
    y = Axis(0, float(max(counts.max(), high)) * 1.08, HEIGHT - BOTTOM, TOP)
    ticks = [tick for tick in y.ticks(4) if tick == round(tick)]
    parts = [frame(y, ticks, [(x(t), f"{t:g}") for t in (0, 0.5, 1)], "rank of the truth")]
    for i, count in enumerate(counts):
        start, end = i / _BINS, (i + 1) / _BINS
        title = f"{start:g} to {end:g}: {count} of {len(ranks)}"
        parts.append(rectangle((x(start) + 1, y(count)), (x(end) - 1, y(0)), "bar", title))
    # Over the bars, or it could not be seen where they are high.
    parts.append(rectangle((x(0), y(high)), (x(1), y(low)), "expected"))
    return svg("histogram of the ranks of the truth", parts)


def expected(num: int) -> tuple[int, int]:
    """5 % and 95 % quantiles of how many of `num` independent uniform ranks a tenth holds."""
    below = bdtr(np.arange(num + 1), num, 1 / _BINS)
    low, high = np.searchsorted(below, (0.05, 0.95))
    return int(low), int(high)


def rank_dots(ranks: dict[str, list[float]]) -> str:
    """A row a parameter, a dot a rank; "" without any, or with too many parameters to read."""
    if not 0 < len(ranks) <= _MOST_ROWS:
        return ""
    bottom = TOP + _ROW * len(ranks)
    x = Axis(0, 1, _NAMES, WIDTH + _NAMES - LEFT - 8)
    parts = [rectangle((x(0.05), TOP), (x(0.95), bottom), "range")]
    for i, (name, given) in enumerate(ranks.items()):
        middle = TOP + _ROW * (i + 0.5)
        parts.append(label(_NAMES - 8, middle + 3.5, _shortened(name), "end"))
        parts.append(line([(x(0), middle), (x(1), middle)], "grid"))
        parts += [dot(x(r), middle, "rank", f"{name}: {r:.2f}") for r in given]
    parts += [label(x(t), bottom + 14, f"{t:g}", "middle") for t in (0, 0.5, 1)]
    parts.append(label(x(0.5), bottom + 30, "rank of the truth", "middle"))
    title = "ranks of the truth, a row a parameter"
    return svg(title, parts, WIDTH + _NAMES - LEFT, bottom + BOTTOM)


def _shortened(name: str, most: int = 19) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"
