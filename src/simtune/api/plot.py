"""Estimates in matplotlib."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simtune.errors import InputError, UnknownName

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from simtune.api.result import Result

_COLOURS = {"identified": "tab:green", "weak": "tab:orange", "not identifiable": "tab:gray"}
_ROW_INCHES = 0.3


def plot_estimates(result: "Result", names: Sequence[str] | None, ax: "Axes | None") -> "Axes":
    """A row a parameter, from its low bound to its high one, along its scale.

    Raises InputError for a run without a search, and UnknownName.
    """
    chosen = chosen_names(result, names)
    coordinates = {c["name"]: c for c in result.content["covariance"]["coordinates"]}
    ax = ax or _new_axes(len(chosen))
    for row, name in enumerate(chosen):
        _draw(ax, row, coordinates[name], result)
    ax.set_yticks(range(len(chosen)), chosen)
    ax.invert_yaxis()
    ax.set_xlim(-0.02, 1.02)
    ax.set_xticks([0, 1], ["low bound", "high bound"])
    ax.set_title(f"{result.task}: estimates, 90 % intervals")
    return ax


def chosen_names(result: "Result", names: Sequence[str] | None) -> list[str]:
    """All parameters, or `names`. Raises InputError for a run without a search, and UnknownName."""
    if not result.content.get("covariance"):
        raise InputError(f"{result.path} has no estimates to plot: nothing was searched for there")
    chosen = list(result.parameters) if names is None else list(names)
    for name in chosen:
        if name not in result.parameters:
            raise UnknownName("parameter", name, str(result.path), result.parameters)
    return chosen


def _draw(ax: "Axes", row: int, coordinate: dict[str, Any], result: "Result") -> None:
    found = result.parameters[coordinate["name"]]
    low, mean, high, initial = (
        _unit(coordinate, value) for value in (found.low, found.mean, found.high, found.initial)
    )
    colour = _COLOURS.get(found.verdict, "tab:gray")
    ax.plot([low, high], [row, row], color=colour, linewidth=4, alpha=0.5)
    ax.plot(mean, row, "o", color=colour)
    ax.plot(initial, row, "|", color="black", markersize=10)
    if found.real is not None:
        ax.plot(_unit(coordinate, found.real), row, "x", color="tab:red")


def _unit(coordinate: dict[str, Any], value: float) -> float:
    """0 at the low bound, 1 at the high one."""
    low, high = coordinate["low"], coordinate["high"]
    if coordinate["scale"] == "log":
        low, high, value = np.log([low, high, value])
    return float((value - low) / (high - low))


def _new_axes(rows: int) -> "Axes":
    try:
        from matplotlib import pyplot
    except ImportError:
        raise ImportError("plot needs matplotlib: pip install matplotlib") from None
    figure, ax = pyplot.subplots(figsize=(6, 1 + _ROW_INCHES * rows), layout="constrained")
    del figure
    return ax
