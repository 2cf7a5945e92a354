"""The picture of benchmarks/accuracy.py: a dot a world, a bar at the median, on a log axis."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # no display
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from baselines.scores import Results, mean_errors

_LEAST_PERCENT = 0.02  # smaller errors, as of sysid, are drawn here
_COLOURS = {
    "posterior": "#0072b2",  # Okabe and Ito's, which the colour-blind can tell apart
    "paper": "#e69f00",
    "regression": "#56b4e9",
    "npe": "#009e73",
    "cmaes": "#cc79a7",
    "sysid": "#7f7f7f",
}
_LABELS = {"npe": "NPE", "cmaes": "CMA-ES", "sysid": "sysid\n(dynamics,\ntrue states)"}


def draw(results: Results, path: Path, title: str) -> None:
    """Write it as a PNG: a panel a task, as wide as it has methods."""
    tasks = list(dict.fromkeys(task for task, _ in results))
    methods = {task: [m for t, m in results if t == task] for task in tasks}
    widths = [len(methods[task]) + 0.6 for task in tasks]
    figure, axes = plt.subplots(
        1,
        len(tasks),
        figsize=(1.2 + 0.66 * sum(widths), 3.6),
        width_ratios=widths,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for panel, task in zip(axes[0], tasks, strict=True):
        for x, method in enumerate(methods[task]):
            _draw_method(panel, x, mean_errors(results[task, method]), _COLOURS[method])
        panel.set_title(task)
        panel.set_xticks(range(len(methods[task])), [_LABELS.get(m, m) for m in methods[task]])
        panel.set_xlim(-0.6, len(methods[task]) - 0.4)
        panel.tick_params(axis="x", length=0, labelsize=7)
        panel.grid(axis="y", which="major", alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    axes[0][0].set_yscale("log")
    axes[0][0].set_ylim(bottom=0.9 * _LEAST_PERCENT)
    axes[0][0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes[0][0].yaxis.set_major_formatter(FuncFormatter(_say))
    axes[0][0].yaxis.set_minor_formatter(NullFormatter())
    axes[0][0].set_ylabel("mean error over parameters")
    figure.suptitle(title, fontsize=10)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _draw_method(panel: Axes, x: int, errors: np.ndarray, colour: str) -> None:
    seen = np.maximum(errors, _LEAST_PERCENT)
    beside = x + 0.12 * np.linspace(-1, 1, len(seen)) * (len(seen) > 1)
    panel.scatter(beside, seen, s=20, color=colour, alpha=0.6, linewidths=0)
    panel.hlines(np.median(seen), x - 0.3, x + 0.3, color=colour, linewidth=2.5)


def _say(percent: float, _: int) -> str:
    return f"{'≤ ' if percent <= _LEAST_PERCENT else ''}{percent:g} %"
