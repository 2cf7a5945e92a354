"""A result's curves and pairs, as figures of matplotlib."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simtune.api.plot import chosen_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from simtune.api.result import Result

_INCHES, _ACROSS = 2.2, 4
_DRAWS = 500  # more only blacken the plot


def plot_curves(result: "Result", names: Sequence[str] | None) -> "Figure":
    """See `Result.plot_curves`."""
    chosen, curves = chosen_names(result, names), result.curves
    rows = -(-len(chosen) // _ACROSS)
    figure, axes = _grid(rows, min(len(chosen), _ACROSS), sharey=True)
    for ax, name in zip(axes.flat, chosen, strict=False):
        found, (candidates, prob_higher) = result.parameters[name], curves[name]
        ax.axvspan(found.low, found.high, color="tab:blue", alpha=0.15)
        ax.plot(candidates, prob_higher, color="tab:blue")
        if found.real is not None:
            ax.axvline(found.real, color="tab:red", linestyle="--")
        ax.set_title(name, fontsize="small")
    for ax in list(axes.flat)[len(chosen) :]:
        ax.set_visible(False)
    figure.supylabel("P(truth > value)")
    return figure


def plot_pairs(result: "Result", names: Sequence[str] | None) -> "Figure":
    """See `Result.plot_pairs`."""
    chosen, draws = chosen_names(result, names), result.samples(_DRAWS)
    figure, axes = _grid(len(chosen), len(chosen), sharex="col")
    for i, j in np.ndindex(axes.shape):
        ax, (x, y) = axes[i, j], (chosen[j], chosen[i])
        if j > i:
            ax.set_visible(False)
            continue
        if i == j:
            ax.hist(draws[x], bins=30, color="tab:blue", alpha=0.6)
            ax.set_yticks([])
        else:
            ax.plot(draws[x], draws[y], ".", markersize=2, alpha=0.5)
        truth_x, truth_y = result.parameters[x].real, result.parameters[y].real
        if truth_x is not None and truth_y is not None and i != j:
            ax.plot(truth_x, truth_y, "x", color="tab:red")
        if i == len(chosen) - 1:
            ax.set_xlabel(x)
        if j == 0 and i:
            ax.set_ylabel(y)
    return figure


def _grid(rows: int, columns: int, **shared: Any) -> tuple["Figure", Any]:
    """A figure, and its (rows, columns) axes."""
    try:
        from matplotlib import pyplot
    except ImportError:
        raise ImportError("plots need matplotlib: pip install matplotlib") from None
    size = (_INCHES * columns, _INCHES * rows)
    return pyplot.subplots(
        rows, columns, figsize=size, layout="constrained", squeeze=False, **shared
    )
