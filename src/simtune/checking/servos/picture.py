"""A PNG of how joints follow their commands in one episode."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from simtune.checking.servos.fit import ServoResponse
from simtune.checking.servos.table import in_thousandths

_COLUMNS, _MAX_JOINTS = 2, 16  # side by side, and in all
_WIDTH_IN, _ROW_IN, _MARGIN_IN = 11.0, 1.9, 0.9
_INK, _COMMAND, _LAG = "#22262b", "#9aa0a6", "#e0301e"


class Curve(NamedTuple):
    """One joint in an episode, in its sensor's unit."""

    unit: str
    command: np.ndarray  # (T,)
    measured: np.ndarray  # (T + 1,), NaN: no reading
    predicted: np.ndarray  # (T,) by a first-order lag with delay and offset
    servo: ServoResponse


def draw_servos(path: Path, name: str, curves: Mapping[str, Curve], step_s: float) -> None:
    """Save each joint's command, its readings, and what a first-order lag makes of the command."""
    shown = dict(list(curves.items())[:_MAX_JOINTS])
    num_rows = -(-len(shown) // _COLUMNS)
    height = _ROW_IN * num_rows + _MARGIN_IN
    figure = Figure(figsize=(_WIDTH_IN, height), facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        num_rows, _COLUMNS, left=0.07, right=0.985, hspace=0.55, wspace=0.16,
        bottom=0.45 / height, top=1 - 0.75 / height,
    )  # fmt: skip
    for place, (joint, curve) in zip(np.ndindex(num_rows, _COLUMNS), shown.items(), strict=False):
        axes: Any = figure.add_subplot(grid[place])
        lines = (curve.command, _COMMAND, "command"), (curve.measured, _INK, "measured")
        for values, colour, says in (*lines, (curve.predicted, _LAG, "lag of 1st order, delay")):
            style = "--" if colour == _LAG else "-"
            seconds = step_s * np.arange(len(values))
            axes.plot(seconds, values, style, color=colour, linewidth=1.1, label=says)
        left = in_thousandths(curve.servo.filtered_rms, curve.unit)
        axes.set_title(f"{joint}, {curve.unit}: {left} left", fontsize=9, color=_INK, loc="left")
        axes.tick_params(labelsize=7, colors=_INK)
        axes.spines[["top", "right"]].set_visible(False)
        axes.margins(x=0)
        if place == (0, 0):
            where = (0.985, 1 - 0.1 / height)
            figure.legend(*axes.get_legend_handles_labels(), loc="upper right", ncols=3,
                          bbox_to_anchor=where, fontsize=9, frameon=False)  # fmt: skip
    says = f"{name}: the first episode, seconds"
    figure.text(0.07, 1 - 0.35 / height, says, fontsize=12, color=_INK, weight="bold")
    figure.savefig(path, dpi=100, format="png")
