"""Plots as inline SVG; colours and line styles are style.css's."""

from simtune.report.axis import Axis, value_axis
from simtune.report.data import History
from simtune.report.words import number, text

_WIDTH, _HEIGHT = 250, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 40, 4, 8, 34


def estimate_plot(
    name: str, history: History, initial: float | None, truth: float | None, is_colour: bool
) -> str:
    """The estimate, its 90 % interval and the searched range against iteration; "" if unknown."""
    if not history.iteration:
        return ""
    known = [v for v in (initial, truth) if v is not None]
    values = [*history.low, *history.high, *history.range_low, *history.range_high, *known]
    steps = history.iteration
    first = steps[0] - (initial is not None)
    x = Axis(first, max(steps[-1], first + 1), _LEFT + 8, _WIDTH - _RIGHT - 8)
    y = value_axis([*values, *history.mean], _HEIGHT - _BOTTOM, _TOP, is_colour)
    labels = [(x(s), f"{s:g}") for s in _some(steps)]
    if initial is not None:
        labels = [(x(first), "start"), *(at for at in labels if at[0] - x(first) > 26)]
    parts = [
        _frame(y, y.ticks(5), labels, "iteration"),
        _band(x, y, steps, history.range_low, history.range_high, "range"),
        _band(x, y, steps, history.low, history.high, "interval"),
        "" if truth is None else _horizontal(y(truth), "truth"),
    ]
    path = [(x(s), y(mean)) for s, mean in zip(steps, history.mean, strict=True)]
    if initial is not None:
        parts.append(_line([(x(first), y(initial)), path[0]], "start"))
        parts.append(_dot(x(first), y(initial), "start", f"start: {number(initial)}"))
    parts.append(_line(path, "estimate"))
    radius = 3 if len(steps) <= 12 else 1.5
    for (px, py), *facts in zip(path, steps, history.mean, history.low, history.high, strict=True):
        step, (mean, low, high) = facts[0], map(number, facts[1:])
        parts.append(
            _dot(px, py, "estimate", f"iteration {step:g}: {mean} [{low}, {high}]", radius)
        )
    return _svg(f"{name}: estimate against iteration", parts)


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
    x = value_axis(candidates, _LEFT + 4, _WIDTH - _RIGHT - 4, is_colour)
    y = Axis(0, 1, _HEIGHT - _BOTTOM, _TOP)
    parts = [_frame(y, [0, 0.5, 1], [(x(t), f"{t:g}") for t in x.ticks(5)], "candidate")]
    if interval is not None:
        left, right = x(interval[0]), x(interval[1])
        parts.append(
            f"<rect class='interval' x='{left:.1f}' y='{_TOP}' width='{right - left:.1f}' "
            f"height='{_HEIGHT - _BOTTOM - _TOP}'/>"
        )
    parts.append(_horizontal(y(0.5), "half"))
    if truth is not None:
        parts.append(_line([(x(truth), _TOP), (x(truth), _HEIGHT - _BOTTOM)], "truth"))
    points = zip(candidates, prob_higher, strict=True)
    parts.append(_line([(x(c), y(p)) for c, p in points], "estimate"))
    return _svg(f"{name}: probability that the truth is higher than a candidate", parts)


def _svg(title: str, parts: list[str]) -> str:
    return (
        f"<svg viewBox='0 0 {_WIDTH} {_HEIGHT}' role='img' aria-label='{text(title)}'>"
        f"{''.join(parts)}</svg>"
    )


def _frame(y: Axis, y_ticks: list[float], x_labels: list[tuple[float, str]], x_title: str) -> str:
    """Grid, labels of both axes, and the horizontal axis's title."""
    bottom = _HEIGHT - _BOTTOM
    parts = []
    for value in y_ticks:
        parts.append(_horizontal(y(value), "grid"))
        parts.append(_label(_LEFT - 6, y(value) + 3.5, f"{value:g}", "end"))
    for px, label in x_labels:
        parts.append(_label(px, bottom + 14, label, "middle"))
    parts.append(_horizontal(bottom, "axis"))
    parts.append(_label((_LEFT + _WIDTH - _RIGHT) / 2, _HEIGHT - 4, x_title, "middle"))
    return "".join(parts)


def _some(steps: list[float], most: int = 6) -> list[float]:
    """Evenly spaced entries, the last one always among them."""
    stride = -(-len(steps) // most)
    return steps[::-1][::stride][::-1]


def _band(x: Axis, y: Axis, steps: list[float], low: list[float], high: list[float], kind: str):
    """The area between two lines; a single iteration gets a bar."""
    if len(steps) == 1:
        px = x(steps[0])
        return (
            f"<rect class='{kind}' x='{px - 6:.1f}' y='{y(high[0]):.1f}' width='12' "
            f"height='{y(low[0]) - y(high[0]):.1f}'/>"
        )
    upper = [(x(s), y(v)) for s, v in zip(steps, high, strict=True)]
    lower = [(x(s), y(v)) for s, v in zip(steps, low, strict=True)]
    return f"<polygon class='{kind}' points='{_points(upper + lower[::-1])}'/>"


def _line(points: list[tuple[float, float]], kind: str) -> str:
    return f"<polyline class='{kind}' points='{_points(points)}'/>"


def _points(points: list[tuple[float, float]]) -> str:
    return " ".join(f"{px:.1f},{py:.1f}" for px, py in points)


def _horizontal(py: float, kind: str) -> str:
    return _line([(_LEFT, py), (_WIDTH - _RIGHT, py)], kind)


def _dot(px: float, py: float, kind: str, title: str, radius: float = 3) -> str:
    shape = f"<circle class='{kind}' cx='{px:.1f}' cy='{py:.1f}' r='{radius}'>"
    return f"{shape}<title>{text(title)}</title></circle>"


def _label(px: float, py: float, label: str, anchor: str) -> str:
    return f"<text x='{px:.1f}' y='{py:.1f}' text-anchor='{anchor}'>{text(label)}</text>"
