"""Plots of two correlated parameters: draws of their joint posterior, and a contour."""

import numpy as np
from scipy.special import ndtr

from simtune.normal import STDS_90
from simtune.report.plot import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    Plot,
    Point,
    value_axis,
)
from simtune.report.trust import Pair
from simtune.run_data import RunData
from simtune.validate import is_number

_DOTS = 250
_NAME = 16  # pixels above the plot, for the vertical axis' name
_AROUND = 0.35  # margin on each side, as a share of the contour's size
_POINTS = 72


def pair_plot(run: RunData, pair: Pair) -> Plot | None:
    """Draws of b against those of a; None if the run has no draws."""
    known = run.posterior
    if known is None or not {pair.a, pair.b} <= set(known.names):
        return None
    indices = [known.names.index(name) for name in (pair.a, pair.b)]
    draws, correlation = known.draws[:, indices], float(known.correlation[*indices])
    contour = _contour(draws, correlation)
    truth = _truth(run, pair)
    around = _AROUND * np.ptp(contour, 0)
    shown = np.stack([contour.min(0) - around, contour.max(0) + around])
    shown = np.clip(shown, draws.min(0), draws.max(0)).tolist() + [truth] * bool(truth)
    xs, ys = map(list, zip(*shown, strict=True))
    x = value_axis(xs, LEFT + 4, WIDTH - RIGHT - 4, run.is_colour(pair.a))
    y = value_axis(ys, HEIGHT - BOTTOM, TOP + _NAME, run.is_colour(pair.b))
    plot = Plot(f"draws of {pair.b} against those of {pair.a}", x, y)
    plot.label_y(y.ticks(5))
    plot.label_x({t: f"{t:g}" for t in x.ticks(4)}, pair.a)
    plot.label(0, TOP + 4, pair.b, "start")
    for a, b in draws[:_DOTS].tolist():
        if x.low <= a <= x.high and y.low <= b <= y.high:
            plot.dot((a, b), "draw", "", 1.4)
    plot.area([(a, b) for a, b in contour.tolist()], "contour")
    if truth:
        plot.dot(truth, "truth", "truth", 4)
    return plot


def _truth(run: RunData, pair: Pair) -> Point | None:
    a, b = (run.parameters[name].get("real") for name in (pair.a, pair.b))
    return (float(a), float(b)) if is_number(a) and is_number(b) else None


def _contour(draws: np.ndarray, correlation: float) -> np.ndarray:
    """(points, 2) contour around the likeliest share 1 − exp(−radius² / 2) of (num, 2) draws.

    A Gaussian copula with the draws' marginals.
    """
    angle = np.linspace(0, 2 * np.pi, _POINTS, endpoint=False)
    u, v = STDS_90 * np.cos(angle), STDS_90 * np.sin(angle)
    normal = u, correlation * u + np.sqrt(max(0, 1 - correlation**2)) * v
    return np.stack([np.quantile(draws[:, i], ndtr(z)) for i, z in enumerate(normal)], 1)
