"""Plots of measured and simulated joint readings over time, and of their differences."""

import numpy as np

from simtune.report.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Axis, Plot
from simtune.report.words import number
from simtune.run_data import RunData
from simtune.validate import is_number

_MOST_POINTS = 300  # of a line: more than there are pixels
_KINDS = ("measured", "before", "after")  # drawn in this order
_UNIT_PX = 12  # above the plot, for the unit
# How far the axis may extend for curves of before tuning, in spans of the other curves: in plots of
# readings, and of differences
_MOST_SPANS = (2, 20)
# Readings that are farther apart than this, times how far nearly all are, are not joined by a line
_HOLE, _NEARLY_ALL = 1.5, 0.9
_SMALL = 0.5  # differences are written in thousandths if all are smaller


def reading_plot(run: RunData, label: str) -> Plot | None:
    """Measured reading, and simulated before and after, over the first episode; None: unknown."""
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
    errors = {name: values - measured for name, values in curves.items()}
    largest = max((np.nanmax(np.abs(values), initial=0) for values in errors.values()), default=0)
    small = bool(largest < _SMALL)
    errors = {name: values * (1000 if small else 1) for name, values in errors.items()}
    title = f"{label}: simulated − measured, before and after, over time"
    return plot_over_time(run, errors, title, "m" * small + _unit(run, label), zero=True)


def in_thousandths(value: object, unit: str) -> str:
    """A value with its unit, in thousandths if small: 0.0123 rad is 12.3 mrad."""
    if not is_number(value):
        return number(value)
    return f"{number(1000 * value)} m{unit}" if abs(value) < _SMALL else f"{number(value)} {unit}"


def plot_over_time(
    run: RunData, curves: dict[str, np.ndarray], title: str, unit: str, zero: bool = False
) -> Plot | None:
    """Plot curves (T + 1,) by kind; `zero`: they are errors, ideally 0."""
    step_s = run.replay.get("step_s")
    known = np.concatenate(list(curves.values()))
    known = known[np.isfinite(known)]
    if not is_number(step_s) or not step_s > 0 or not len(known):
        return None
    longest = max(map(len, curves.values()))
    times = np.arange(longest) * step_s
    x = Axis(0, max(times[-1], step_s), LEFT + 4, WIDTH - RIGHT - 4)
    low, high = _ends(curves, zero)
    air = 0.06 * (high - low) or 1e-3  # always linear: an angle's zero is arbitrary
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
    """Ends of the vertical axis. Diverging curves of before tuning are drawn at its edge, so that
    the others can be seen.
    """
    kept = [values for name, values in curves.items() if name != "before"] or [*curves.values()]
    full, core = (np.concatenate([*group, [0.0] * zero]) for group in (curves.values(), kept))
    low, high, span = (
        np.nanmin(core),
        np.nanmax(core),
        _MOST_SPANS[zero] * np.ptp(core[np.isfinite(core)]),
    )
    if not span:
        return float(np.nanmin(full)), float(np.nanmax(full))
    return float(max(np.nanmin(full), low - span)), float(min(np.nanmax(full), high + span))


def _lines(times: np.ndarray, values: np.ndarray) -> list[list[tuple[float, float]]]:
    """Stretches of known values, of (T + 1,), thinned to about `_MOST_POINTS`.

    A sensor that is read in every few rows is one line; it is open where more rows are missing.
    """
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return []
    apart, stride = np.diff(known), -(-len(known) // _MOST_POINTS)
    holes = np.flatnonzero(apart > _HOLE * np.quantile(apart, _NEARLY_ALL)) + 1
    lines = []
    for rows in np.split(known, holes):
        kept = np.unique(np.append(rows[::stride], rows[-1]))
        lines.append(list(zip(times[kept].tolist(), values[kept].tolist(), strict=True)))
    return [line for line in lines if len(line) > 1]


def curves_of(run: RunData, label: str) -> dict[str, np.ndarray]:
    """{"measured", "before" or "after": (T + 1,)}, NaN if unknown; empty without measurements."""
    facts, found = _of(run, label), {}
    for name in _KINDS:
        listed = facts.get(name)
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
    facts = sensors.get(label) if isinstance(sensors, dict) else None
    return facts if isinstance(facts, dict) else {}
