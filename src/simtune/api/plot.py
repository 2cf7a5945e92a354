"""Plots of estimates, survival curves and pairs of parameters in matplotlib."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simtune.api.estimate import ParameterEstimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"identified": "tab:green", "weak": "tab:orange", "not identifiable": "tab:gray"}
_ROW_INCHES, _PANEL_INCHES, _ACROSS = 0.3, 2.2, 4


def plot_estimates(
    estimates: Sequence[ParameterEstimate],
    coordinates: Mapping[str, Mapping[str, Any]],
    title: str,
    ax: "Axes | None",
) -> "Axes":
    """One row per parameter, from its low to its high bound, along its scale.

    `coordinates`: scale, low and high of each parameter, by name.
    """
    ax = ax or _rows(len(estimates))
    for row, estimate in enumerate(estimates):
        _draw_row(ax, row, estimate, coordinates[estimate.name])
    ax.set_yticks(range(len(estimates)), [estimate.name for estimate in estimates])
    ax.invert_yaxis()
    ax.set_xlim(-0.02, 1.02)
    ax.set_xticks([0, 1], ["low bound", "high bound"])
    ax.set_title(title)
    return ax


def plot_curves(
    estimates: Sequence[ParameterEstimate], curves: Mapping[str, tuple[np.ndarray, np.ndarray]]
) -> "Figure":
    """`curves`: candidates (C,) and P(truth > candidate) (C,) of each parameter, by name."""
    rows = -(-len(estimates) // _ACROSS)
    figure, axes = _grid(rows, min(len(estimates), _ACROSS), sharey=True)
    for ax, estimate in zip(axes.flat, estimates, strict=False):
        ax.axvspan(estimate.low, estimate.high, color="tab:blue", alpha=0.15)
        ax.plot(*curves[estimate.name], color="tab:blue")
        if estimate.real is not None:
            ax.axvline(estimate.real, color="tab:red", linestyle="--")
        ax.set_title(estimate.name, fontsize="small")
    for ax in list(axes.flat)[len(estimates) :]:
        ax.set_visible(False)
    figure.supylabel("P(truth > value)")
    return figure


def plot_pairs(estimates: Sequence[ParameterEstimate], draws: Mapping[str, np.ndarray]) -> "Figure":
    """`draws`: (S,) draws of the joint posterior for each parameter, by name."""
    last = len(estimates) - 1
    figure, axes = _grid(len(estimates), len(estimates), sharex="col")
    for i, j in np.ndindex(axes.shape):
        ax, x, y = axes[i, j], estimates[j], estimates[i]
        if j > i:
            ax.set_visible(False)
        elif i == j:
            ax.hist(draws[x.name], bins=30, color="tab:blue", alpha=0.6)
            ax.set_yticks([])
        else:
            ax.plot(draws[x.name], draws[y.name], ".", markersize=2, alpha=0.5)
            if x.real is not None and y.real is not None:
                ax.plot(x.real, y.real, "x", color="tab:red")
        if i == last:
            ax.set_xlabel(x.name)
        if j == 0 and i:
            ax.set_ylabel(y.name)
    return figure


def _draw_row(
    ax: "Axes", row: int, estimate: ParameterEstimate, coordinate: Mapping[str, Any]
) -> None:
    values = (estimate.low, estimate.mean, estimate.high, estimate.initial)
    low, mean, high, initial = (_unit(coordinate, value) for value in values)
    colour = _COLOURS.get(estimate.verdict, "tab:gray")
    ax.plot([low, high], [row, row], color=colour, linewidth=4, alpha=0.5)
    ax.plot(mean, row, "o", color=colour)
    ax.plot(initial, row, "|", color="black", markersize=10)
    if estimate.real is not None:
        ax.plot(_unit(coordinate, estimate.real), row, "x", color="tab:red")


def _unit(coordinate: Mapping[str, Any], value: float) -> float:
    """Unit coordinate of a value: 0 at the low bound, 1 at the high one."""
    low, high = coordinate["low"], coordinate["high"]
    if coordinate["scale"] == "log":
        low, high, value = np.log([low, high, value])
    return float((value - low) / (high - low))


def _rows(num: int) -> "Axes":
    size = (6, 1 + _ROW_INCHES * num)
    return _pyplot().subplots(figsize=size, layout="constrained")[1]


def _grid(rows: int, columns: int, **shared: Any) -> tuple["Figure", Any]:
    """A figure and its (rows, columns) axes."""
    size = (_PANEL_INCHES * columns, _PANEL_INCHES * rows)
    return _pyplot().subplots(
        rows, columns, figsize=size, layout="constrained", squeeze=False, **shared
    )


def _pyplot() -> Any:
    try:
        from matplotlib import pyplot
    except ImportError:
        raise ImportError("plots need matplotlib: pip install matplotlib") from None
    return pyplot
