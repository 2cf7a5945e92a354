"""Joint readings over time beside the simulator's, and what is left between them."""

from itertools import groupby

import numpy as np

from simtune.report.data import RunData
from simtune.report.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Axis, Plot
from simtune.report.words import number
from simtune.validate import is_number

_MOST_POINTS = 300  # of a line: more than there are pixels
_KINDS = ("measured", "before", "after")  # drawn in this order
_UNIT_PX = 12  # above the plot, for the unit
_MOST_SPANS = (2, 20)  # times what is measured; what is left after: that curves before may take
_SMALL = 0.5  # what is left, where no number is larger, is written in thousandths


def reading_plot(run: RunData, label: str) -> Plot | None:
    """Measured, and simulated before and after, over the first episode; None of what is unknown."""
    curves = curves_of(run, label)
    if "measured" not in curves:
        return None
    title = f"{label}: measured, and simulated before and after, over time"
    return plot_over_time(run, curves, title, _unit(run, label))


def error_plot(run: RunData, label: str) -> Plot | None:
    """Simulated − measured, before and after."""
    curves = curves_of(run, label)
    measured = curves.pop("measured", None)
    if measured is None or not curves:
        return None
    left = {name: its - measured for name, its in curves.items()}
    largest = max((np.nanmax(np.abs(its), initial=0) for its in left.values()), default=0)
    small = bool(largest < _SMALL)
    left = {name: its * (1000 if small else 1) for name, its in left.items()}
    title = f"{label}: simulated − measured, before and after, over time"
    return plot_over_time(run, left, title, "m" * small + _unit(run, label), zero=True)


def in_thousandths(value: object, unit: str) -> str:
    """A small length with its unit: 0.0123 rad is 12.3 mrad."""
    if not is_number(value):
        return number(value)
    return f"{number(1000 * value)} m{unit}" if abs(value) < _SMALL else f"{number(value)} {unit}"


def plot_over_time(
    run: RunData, curves: dict[str, np.ndarray], title: str, unit: str, zero: bool = False
) -> Plot | None:
    """Curves (T + 1,) by kind; `zero`: what is left of something, whose best is 0."""
    step_s = run.replay.get("step_s")
    known = np.concatenate(list(curves.values()))
    known = known[np.isfinite(known)]
    if not is_number(step_s) or not step_s > 0 or not len(known):
        return None
    longest = max(map(len, curves.values()))
    times = np.arange(longest) * step_s
    x = Axis(0, max(times[-1], step_s), LEFT + 4, WIDTH - RIGHT - 4)
    low, high = _ends(curves, zero)
    air = 0.06 * (high - low) or 1e-3  # always linear: an angle's zero is nowhere special
    y = Axis(low - air, high + air, HEIGHT - BOTTOM, TOP + _UNIT_PX)
    plot = Plot(title, x, y)
    plot.label_y(y.ticks(5))
    plot.label(0, TOP + 2, unit, "start")
    plot.label_x({t: f"{t:g}" for t in x.ticks(5)}, "seconds")
    if zero:
        plot.across(0.0, "half")
    for name in _KINDS:
        for line in _lines(times, curves[name]) if name in curves else []:
            plot.line(line, name)
    return plot


def _ends(curves: dict[str, np.ndarray], zero: bool) -> tuple[float, float]:
    """Of the vertical axis. What diverged before tuning is drawn at its edge: the rest is seen."""
    kept = [its for name, its in curves.items() if name != "before"] or [*curves.values()]
    every, core = (np.concatenate([*its, [0.0] * zero]) for its in (curves.values(), kept))
    low, high, span = (
        np.nanmin(core),
        np.nanmax(core),
        _MOST_SPANS[zero] * np.ptp(core[np.isfinite(core)]),
    )
    if not span:
        return float(np.nanmin(every)), float(np.nanmax(every))
    return float(max(np.nanmin(every), low - span)), float(min(np.nanmax(every), high + span))


def _lines(times: np.ndarray, values: np.ndarray) -> list[list[tuple[float, float]]]:
    """Stretches between what was not read, of not too many points."""
    stride = max(1, -(-len(values) // _MOST_POINTS))
    points = list(zip(times[::stride].tolist(), values[::stride].tolist(), strict=False))
    stretches = groupby(points, lambda point: bool(np.isfinite(point[1])))
    return [line for is_known, its in stretches if is_known and len(line := list(its)) > 1]


def curves_of(run: RunData, label: str) -> dict[str, np.ndarray]:
    """{"measured", "before", "after": (T + 1,)} of what there is; NaN where nothing is known."""
    its, found = _of(run, label), {}
    for name in _KINDS:
        listed = its.get(name)
        if isinstance(listed, list) and listed:
            found[name] = np.array([v if is_number(v) else np.nan for v in listed], float)
    shortest = min(map(len, found.values()), default=0)
    found = {name: values[:shortest] for name, values in found.items()}
    return found if np.isfinite(found.get("measured", [])).any() else {}


def _unit(run: RunData, label: str) -> str:
    unit = _of(run, label).get("unit")
    return unit if isinstance(unit, str) else ""


def _of(run: RunData, label: str) -> dict:
    sensors = run.replay.get("sensors")
    its = sensors.get(label) if isinstance(sensors, dict) else None
    return its if isinstance(its, dict) else {}
