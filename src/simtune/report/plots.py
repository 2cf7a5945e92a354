"""A parameter's plots, as inline SVG."""

from simtune.report.axis import Axis, value_axis
from simtune.report.data import History
from simtune.report.svg import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    dot,
    frame,
    horizontal,
    line,
    polygon,
    rectangle,
    svg,
)
from simtune.report.words import number


def estimate_plot(
    name: str, history: History, initial: float | None, truth: float | None, is_colour: bool
) -> str:
    """The estimate, its interval and the searched range against rounds; "" if unknown."""
    if not history.round:
        return ""
    known = [v for v in (initial, truth) if v is not None]
    values = [*history.low, *history.high, *history.range_low, *history.range_high, *known]
    steps = history.round
    first = steps[0] - (initial is not None)
    x = Axis(first, max(steps[-1], first + 1), LEFT + 8, WIDTH - RIGHT - 8)
    y = value_axis([*values, *history.mean], HEIGHT - BOTTOM, TOP, is_colour)
    labels = [(x(s), f"{s:g}") for s in _some(steps)]
    if initial is not None:
        labels = [(x(first), "start"), *(at for at in labels if at[0] - x(first) > 26)]
    parts = [
        frame(y, y.ticks(5), labels, "round"),
        _band(x, y, steps, history.range_low, history.range_high, "range"),
        _band(x, y, steps, history.low, history.high, "interval"),
        "" if truth is None else horizontal(y(truth), "truth"),
    ]
    path = [(x(s), y(mean)) for s, mean in zip(steps, history.mean, strict=True)]
    if initial is not None:
        parts.append(line([(x(first), y(initial)), path[0]], "start"))
        parts.append(dot(x(first), y(initial), "start", f"start: {number(initial)}"))
    parts.append(line(path, "estimate"))
    radius = 3 if len(steps) <= 12 else 1.5
    for (px, py), *facts in zip(path, steps, history.mean, history.low, history.high, strict=True):
        step, (mean, low, high) = facts[0], map(number, facts[1:])
        parts.append(dot(px, py, "estimate", f"round {step:g}: {mean} [{low}, {high}]", radius))
    return svg(f"{name}: estimate against the search's rounds", parts)


def survival_plot(
    name: str,
    candidates: list[float],
    prob_higher: list[float],
    interval: tuple[float, float] | None,
    truth: float | None,
    is_colour: bool,
) -> str:
    """P(truth > candidate) against the candidate, the 90 % interval shaded; "" if unknown."""
    if len(candidates) < 2 or len(candidates) != len(prob_higher):
        return ""
    x = value_axis(candidates, LEFT + 4, WIDTH - RIGHT - 4, is_colour)
    y = Axis(0, 1, HEIGHT - BOTTOM, TOP)
    parts = [frame(y, [0, 0.5, 1], [(x(t), f"{t:g}") for t in x.ticks(5)], "candidate")]
    if interval is not None:
        low, high = (x(end) for end in interval)
        parts.append(rectangle((low, TOP), (high, HEIGHT - BOTTOM), "interval"))
    parts.append(horizontal(y(0.5), "half"))
    if truth is not None:
        parts.append(line([(x(truth), TOP), (x(truth), HEIGHT - BOTTOM)], "truth"))
    points = zip(candidates, prob_higher, strict=True)
    parts.append(line([(x(c), y(p)) for c, p in points], "estimate"))
    return svg(f"{name}: probability that the truth is higher than a candidate", parts)


def _some(steps: list[float], most: int = 6) -> list[float]:
    """Evenly spaced entries, the last one always among them."""
    stride = -(-len(steps) // most)
    return steps[::-1][::stride][::-1]


def _band(x: Axis, y: Axis, steps: list[float], low: list[float], high: list[float], kind: str):
    """The area between two lines; a single round gets a bar."""
    if len(steps) == 1:
        px = x(steps[0])
        return rectangle((px - 6, y(high[0])), (px + 6, y(low[0])), kind)
    upper = [(x(s), y(v)) for s, v in zip(steps, high, strict=True)]
    lower = [(x(s), y(v)) for s, v in zip(steps, low, strict=True)]
    return polygon(upper + lower[::-1], kind)
