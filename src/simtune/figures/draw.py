"""Draws figures with the report's plots."""

from simtune.figures.curves import Band
from simtune.figures.figure import Figure, Series
from simtune.figures.groups import ORDER
from simtune.report.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, Axis, Mark, Plot, value_axis
from simtune.report.words import number
from simtune.validate import is_number

WIDTH = 300
LEGEND = 20  # pixels above a plot
_CHARACTER_PX = 6.4  # approximate width of a label's character
_KNOWN_KINDS = (*ORDER, "tune")


def colour(kind: str) -> str:
    """Name of a series' colour in style.css and raster.py."""
    return kind if kind in _KNOWN_KINDS else "other"


def draw(figure: Figure) -> Plot:
    """Draw each series with its interval, and dashed horizontal lines for references."""
    bands = [series.band for series in figure.series if series.band]
    values = [v for band in bands for _, c in band for v in (c.mean, c.low, c.high) if is_number(v)]
    values += [reference.value for reference in figure.references] + [0.0]
    if figure.y_title.startswith("success"):
        values.append(1.0)
    places = [x for band in bands for x, _ in band]
    y = value_axis(values, HEIGHT - BOTTOM, TOP, is_colour=False)
    plot = Plot(figure.title, _x_axis(places, figure), y, WIDTH)
    plot.label_y(y.ticks(5))
    plot.label_x(_x_labels(figure, plot.x), figure.x_title)
    for reference in figure.references:
        kind = colour(reference.label)
        plot.across(reference.value, f"level {kind}")
    for series in figure.series:
        _draw(plot, series)
    return plot


def with_legend(figure: Figure) -> Plot:
    """Like `draw`, with a legend of the colours above, for use outside the page."""
    plot, px = draw(figure), float(LEFT)
    kinds = [(series.label, series.kind) for series in figure.series if series.band]
    kinds += [(reference.label, reference.label) for reference in figure.references]
    for label, kind in dict(kinds).items():
        attributes = {"class": f"label {colour(kind)}", "x": px, "y": -LEGEND / 2}
        plot.marks.append(Mark("text", attributes | {"text-anchor": "start"}, label))
        px += _CHARACTER_PX * len(label) + 12
    return plot


def _x_axis(places: list[float], figure: Figure) -> Axis:
    start, end = LEFT + 10, WIDTH - RIGHT - 10
    if figure.categories:
        return Axis(-0.5, max(places) + 0.5, start, end)
    if figure.is_ablation and min(places) > 0 and max(places) / min(places) >= 8:
        return Axis(min(places), max(places), start, end, log=True)
    low = 0.0 if min(places) >= 0 else min(places)
    return Axis(low, max(max(places), low + 1e-9), start, end)


def _x_labels(figure: Figure, x: Axis) -> dict[float, str]:
    if figure.categories:
        return {float(i): name for i, name in enumerate(figure.categories)}
    return {t: f"{t / 1000:g}k" if t >= 10_000 else f"{t:g}" for t in x.ticks(5)}


def _draw(plot: Plot, series: Series) -> None:
    kind, band = colour(series.kind), series.band
    known = [(x, c) for x, c in band if is_number(c.low)]
    if series.line and len(known) > 1:
        upper, lower = [(x, c.high) for x, c in known], [(x, c.low) for x, c in known[::-1]]
        plot.area(upper + lower, f"band {kind}")
    if series.line and len(band) > 1:
        plot.line([(x, c.mean) for x, c in band], f"series {kind}")
    if len(band) <= 12:
        _draw_dots(plot, series.label, kind, band, bars=not series.line or len(known) == 1)


def _draw_dots(plot: Plot, label: str, kind: str, band: Band, bars: bool) -> None:
    for x, c in band:
        has_bar = bars and is_number(c.low)
        if has_bar:
            plot.line([(x, c.low), (x, c.high)], f"series {kind}")
        span = f" [{number(c.low)}, {number(c.high)}]" if is_number(c.low) else ""
        plot.dot((x, c.mean), f"dot {kind}", f"{label}: {number(c.mean)}{span}, {c.num} runs")
