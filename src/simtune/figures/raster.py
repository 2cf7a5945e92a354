"""Draws a plot's marks as PNG, for places that do not accept SVG."""

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.text import Text

from simtune.figures.draw import LEGEND
from simtune.report.plot import Mark, Plot

COLOURS = {
    "autotune": "#2563eb",
    "tune": "#2563eb",
    "regression": "#9333ea",
    "dr": "#c2680a",
    "untuned": "#be185d",
    "oracle": "#15803d",
    "other": "#5b6777",
    "grid": "#dfe4ea",
    "axis": "#5b6777",
}
_DPI = 100
_PX_PER_UNIT = 2  # of the plot
_ANCHORS = {"middle": "center", "end": "right", "start": "left"}


def png(plot: Plot) -> bytes:
    """PNG of the plot and its legend, twice as large as the SVG, on white."""
    scale, bottom = _PX_PER_UNIT / _DPI, plot.height + 4
    canvas = Canvas(figsize=(plot.width * scale, (bottom + LEGEND) * scale), dpi=_DPI)
    FigureCanvasAgg(canvas)
    axes = canvas.add_axes((0, 0, 1, 1), xlim=(0, plot.width), ylim=(bottom, -LEGEND))
    axes.set_axis_off()
    for order, mark in enumerate(plot.marks):  # later marks lie above, whatever their type
        axes.add_artist(_artist(mark)).set_zorder(order)
    file = io.BytesIO()
    canvas.savefig(file, format="png", dpi=_DPI)
    return file.getvalue()


def _artist(mark: Mark) -> Line2D | Polygon | Circle | Text:
    attributes = mark.attributes
    kind, tone = (*str(attributes.get("class", "axis")).split(), "axis")[:2]
    tone = COLOURS[kind if kind in COLOURS else tone]
    width = {"series": 2.0, "level": 1.4}.get(kind, 1.0) * 0.72 * _PX_PER_UNIT  # points
    if mark.tag == "text":
        anchor = _ANCHORS[str(attributes["text-anchor"])]
        size = 11 * 0.72 * _PX_PER_UNIT
        x, y = float(attributes["x"]), float(attributes["y"])
        return Text(x, y, mark.words, color=tone, fontsize=size, ha=anchor)
    if mark.tag == "circle":
        x, y, radius = (float(attributes[key]) for key in ("cx", "cy", "r"))
        return Circle((x, y), radius, color=tone)
    points = [tuple(map(float, pair.split(","))) for pair in str(attributes["points"]).split()]
    if mark.tag == "polygon":
        return Polygon(points, color=tone, alpha=0.18, linewidth=0)
    style = (0, (5, 3)) if kind == "level" else "-"
    return Line2D(*zip(*points, strict=True), color=tone, linewidth=width, linestyle=style)
