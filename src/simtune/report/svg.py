"""What plots are made of, as SVG; colours and line styles are style.css's."""

from simtune.report.axis import Axis
from simtune.report.words import text

WIDTH, HEIGHT = 250, 170
LEFT, RIGHT, TOP, BOTTOM = 40, 4, 8, 34  # margins

Point = tuple[float, float]


def svg(title: str, parts: list[str], width: float = WIDTH, height: float = HEIGHT) -> str:
    return (
        f"<svg viewBox='0 0 {width:g} {height:g}' role='img' aria-label='{text(title)}'>"
        f"{''.join(parts)}</svg>"
    )


def frame(y: Axis, y_ticks: list[float], x_labels: list[tuple[float, str]], x_title: str) -> str:
    """Grid, labels of both axes, and the horizontal axis's title."""
    bottom = HEIGHT - BOTTOM
    parts = []
    for value in y_ticks:
        parts.append(horizontal(y(value), "grid"))
        parts.append(label(LEFT - 6, y(value) + 3.5, f"{value:g}", "end"))
    for px, words in x_labels:
        parts.append(label(px, bottom + 14, words, "middle"))
    parts.append(horizontal(bottom, "axis"))
    parts.append(label((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 4, x_title, "middle"))
    return "".join(parts)


def horizontal(py: float, kind: str) -> str:
    return line([(LEFT, py), (WIDTH - RIGHT, py)], kind)


def line(points: list[Point], kind: str) -> str:
    return f"<polyline class='{kind}' points='{_listed(points)}'/>"


def polygon(points: list[Point], kind: str) -> str:
    return f"<polygon class='{kind}' points='{_listed(points)}'/>"


def _listed(points: list[Point]) -> str:
    return " ".join(f"{px:.1f},{py:.1f}" for px, py in points)


def rectangle(start: Point, end: Point, kind: str, title: str = "") -> str:
    """From its upper left corner to its lower right one."""
    (left, top), (right, bottom) = start, end
    size = f"width='{right - left:.1f}' height='{bottom - top:.1f}'"
    shape = f"<rect class='{kind}' x='{left:.1f}' y='{top:.1f}' {size}"
    return f"{shape}><title>{text(title)}</title></rect>" if title else f"{shape}/>"


def dot(px: float, py: float, kind: str, title: str, radius: float = 3) -> str:
    shape = f"<circle class='{kind}' cx='{px:.1f}' cy='{py:.1f}' r='{radius}'>"
    return f"{shape}<title>{text(title)}</title></circle>"


def label(px: float, py: float, words: str, anchor: str) -> str:
    return f"<text x='{px:.1f}' y='{py:.1f}' text-anchor='{anchor}'>{text(words)}</text>"
