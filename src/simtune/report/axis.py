"""An axis of a plot: values to pixels, and round numbers to label."""

import math
from dataclasses import dataclass

_WIDE = 6  # a positive range this many times its lower end is drawn on a log scale


@dataclass(frozen=True)
class Axis:
    """Maps [low, high] onto pixels [start, end]."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        """Pixel of a value; what lies outside is drawn at the edge."""
        value = min(max(value, self.low), self.high)
        low, high = self._spread(self.low), self._spread(self.high)
        share = (self._spread(value) - low) / (high - low)
        return self.start + share * (self.end - self.start)

    def _spread(self, value: float) -> float:
        return math.log(value) if self.log else value

    def ticks(self, most: int = 6) -> list[float]:
        """At most `most` round numbers within the axis, ascending."""
        if self.log:
            for digits in ((1, 2, 5), (1, 3), (1,)):
                ticks = self._log_ticks(digits)
                if 2 <= len(ticks) <= most:
                    return ticks
            if len(ticks) > most:
                return ticks[:: math.ceil(len(ticks) / most)]
        return self._linear_ticks(most)

    def _log_ticks(self, digits: tuple[int, ...]) -> list[float]:
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        values = [float(f"{d}e{power}") for power in range(first, last + 1) for d in digits]
        return [value for value in values if self.low <= value <= self.high]

    def _linear_ticks(self, most: int) -> list[float]:
        raw = (self.high - self.low) / most
        power = math.floor(math.log10(raw))
        step = next(s for d in (1, 2, 5, 10) if (s := float(f"{d}e{power}")) >= raw * (1 - 1e-9))
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [round(i * step, 12) for i in range(first, last + 1)]


def value_axis(values: list[float], start: float, end: float, is_colour: bool) -> Axis:
    """An axis on which all the values of a parameter are seen, with some air around.

    A colour's axis is linear and ends at 0 and 1.
    """
    low, high = min(values), max(values)
    if low > 0 and high / low >= _WIDE and not is_colour:
        air = (high / low) ** 0.06
        return Axis(low / air, high * air, start, end, log=True)
    air = 0.06 * (high - low) or abs(high) * 0.1 or 1.0
    low, high = low - air, high + air
    return Axis(max(low, 0), min(high, 1), start, end) if is_colour else Axis(low, high, start, end)
