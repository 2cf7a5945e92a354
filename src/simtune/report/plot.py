"""A plot as its axes and marks; templates/macros.html writes it as SVG, style.css colours it."""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from matplotlib.ticker import Locator, LogLocator, MaxNLocator

WIDTH, HEIGHT = 250, 170
LEFT, RIGHT, TOP, BOTTOM = 40, 4, 8, 34  # margins
_DIGIT = 7  # pixels of a number's digit
_WIDE = 6  # a positive range this many times its lower end is drawn on a log scale

Point = tuple[float, float]


@dataclass(frozen=True)
class Axis:
    """Maps [low, high] onto pixels [start, end]."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Pixel of a value; values outside are drawn at the edge."""
        value = min(max(value, self.low), self.high)
        low, high = self._spread(self.low), self._spread(self.high)
        share = (self._spread(value) - low) / (high - low)
        return self.start + share * (self.end - self.start)

    def _spread(self, value: float) -> float:
        return math.log(value) if self.log else value

    def ticks(self, most: int) -> list[float]:
        """About `most` round numbers within the axis, ascending."""
        for digits in ((1, 2, 5), (1, 3), (1,)) if self.log else ():
            ticks = self._within(LogLocator(subs=digits, numticks=most))
            if 2 <= len(ticks) <= most and self._can_be_told_apart(ticks):
                return ticks
        ticks = self._within(MaxNLocator(most, steps=[1, 2, 5, 10]))
        while len(ticks) > 2 and not self._can_be_told_apart(ticks):
            ticks = ticks[len(ticks) % 2 == 0 :: 2]  # keeps the last tick
        return ticks

    def _can_be_told_apart(self, ticks: list[float]) -> bool:
        """Whether the ticks' numbers do not overlap, side by side along an x axis."""
        if self.start > self.end:
            return True
        widths = [_DIGIT * len(f"{tick:g}") for tick in ticks]
        places = [self(tick) for tick in ticks]
        pairs = zip(pairwise(places), pairwise(widths), strict=True)
        return all(b - a >= (left + right) / 2 + _DIGIT for (a, b), (left, right) in pairs)

    def _within(self, locator: Locator) -> list[float]:
        ticks = [float(tick) for tick in locator.tick_values(self.low, self.high)]
        tiny = 1e-9 * (self.high - self.low)  # zero after rounding
        return [t if abs(t) > tiny else 0.0 for t in ticks if self.low <= t <= self.high]


def value_axis(values: list[float], start: float, end: float, is_colour: bool) -> Axis:
    """An axis that shows all values of a parameter, with some margin.

    A colour's axis is linear and ends at 0 and 1.
    """
    low, high = min(values), max(values)
    if low > 0 and high / low >= _WIDE and not is_colour:
        air = (high / low) ** 0.06
        return Axis(low / air, high * air, start, end, log=True)
    air = 0.06 * (high - low) or abs(high) * 0.1 or 1.0
    low, high = low - air, high + air
    return Axis(max(low, 0), min(high, 1), start, end) if is_colour else Axis(low, high, start, end)


class Mark(NamedTuple):
    """An element of SVG."""

    tag: str
    attributes: dict[str, float | str]
    words: str = ""  # the text itself, or the tooltip of another mark


@dataclass(frozen=True)
class Plot:
    """Marks at the values of two axes."""

    title: str
    x: Axis
    y: Axis
    width: float = WIDTH
    marks: list[Mark] = field(default_factory=list)

    @property
    def bottom(self) -> float:
        return max(self.y.start, self.y.end)

    @property
    def height(self) -> float:
        return self.bottom + BOTTOM

    def line(self, points: list[Point], kind: str) -> None:
        self._add("polyline", kind, points=self._pixels(points))

    def area(self, points: list[Point], kind: str) -> None:
        self._add("polygon", kind, points=self._pixels(points))

    def across(self, value: float, kind: str) -> None:
        """A horizontal line over the full width."""
        py = self.y(value)
        points = f"{LEFT:.1f},{py:.1f} {self.width - RIGHT:.1f},{py:.1f}"
        self._add("polyline", kind, points=points)

    def box(self, start: Point, end: Point, kind: str, title: str = "", inset: float = 0) -> None:
        """A box from its upper left to its lower right corner, `inset` pixels narrower per side."""
        left, right = self.x(start[0]) + inset, self.x(end[0]) - inset
        top, bottom = self.y(start[1]), self.y(end[1])
        size = {"width": right - left, "height": bottom - top}
        self._add("rect", kind, title, x=left, y=top, **size)

    def dot(self, at: Point, kind: str, title: str, radius: float = 3) -> None:
        self._add("circle", kind, title, cx=self.x(at[0]), cy=self.y(at[1]), r=radius)

    def label(self, px: float, py: float, words: str, anchor: str = "middle") -> None:
        self.marks.append(Mark("text", {"x": px, "y": py, "text-anchor": anchor}, words))

    def label_y(self, ticks: list[float]) -> None:
        """Horizontal grid lines with numbers."""
        for value in ticks:
            self.across(value, "grid")
            self.label(LEFT - 6, self.y(value) + 3.5, f"{value:g}", "end")
        self.across(self.y.low, "axis")

    def label_x(self, labels: dict[float, str], title: str) -> None:
        for value, words in labels.items():
            self.label(self.x(value), self.bottom + 14, words)
        self.label((self.x.start + self.x.end) / 2, self.bottom + 30, title)

    def _pixels(self, points: list[Point]) -> str:
        return " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in points)

    def _add(self, tag: str, kind: str, title: str = "", **attributes: float | str) -> None:
        self.marks.append(Mark(tag, {"class": kind, **attributes}, title))
