"""Plots of a parameter, and of a policy's learning; None if there is too little data."""

from simtune.report.plot import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, Axis, Plot, value_axis
from simtune.report.words import as_precise, interval, number
from simtune.run_data import RunData
from simtune.validate import is_number


def estimate_plot(run: RunData, name: str) -> Plot | None:
    """The estimate, its 90 % interval, if any, and the searched range against rounds."""
    history = run.history(name)
    if not history:
        return None
    initial, truth = _known(run, name, "initial", "real")
    rounds = [e.round for e in history]
    first = rounds[0] - (initial is not None)
    values = [value for e in history for value in e[1:]]
    values += [value for value in (initial, truth) if value is not None]
    x = Axis(first, max(rounds[-1], first + 1), LEFT + 8, WIDTH - RIGHT - 8)
    y = value_axis(values, HEIGHT - BOTTOM, TOP, run.is_colour(name))
    plot = Plot(f"{name}: estimate against the search's rounds", x, y)
    plot.label_y(y.ticks(5))
    labels = {r: f"{r:g}" for r in _some(rounds)}
    if initial is not None:
        labels = {first: "start"} | {r: s for r, s in labels.items() if x(r) - x(first) > 26}
    plot.label_x(labels, "round")
    _band(plot, [(e.round, e.range_low, e.range_high) for e in history], "range")
    if run.has_intervals:
        _band(plot, [(e.round, e.low, e.high) for e in history], "interval")
    if truth is not None:
        plot.across(truth, "truth")
    if initial is not None:
        plot.line([(first, initial), (rounds[0], history[0].mean)], "start")
        plot.dot((first, initial), "start", f"start: {number(initial)}")
    plot.line([(e.round, e.mean) for e in history], "estimate")
    radius = 3 if len(history) <= 12 else 1.5
    for e in history:
        facts = {"low": e.low, "high": e.high}
        title = f"round {e.round:g}: {as_precise(e.mean, facts)} {interval(facts)}"
        plot.dot((e.round, e.mean), "estimate", title, radius)
    return plot


def survival_plot(run: RunData, name: str) -> Plot | None:
    """P(truth > value) against the value, with the 90 % interval shaded."""
    curve = run.curves.get(name) or {}
    candidates, prob_higher = curve.get("candidates", []), curve.get("prob_higher", [])
    if len(candidates) < 2 or len(candidates) != len(prob_higher):
        return None
    truth, low, high = _known(run, name, "real", "low", "high")
    x = value_axis(candidates, LEFT + 4, WIDTH - RIGHT - 4, run.is_colour(name))
    y = Axis(0, 1, HEIGHT - BOTTOM, TOP)
    plot = Plot(f"{name}: probability that the truth is higher than a value", x, y)
    plot.label_y([0, 0.5, 1])
    plot.label_x({t: f"{t:g}" for t in x.ticks(5)}, "value")
    if low is not None and high is not None:
        plot.box((low, 1), (high, 0), "interval")
    plot.across(0.5, "half")
    if truth is not None:
        plot.line([(truth, 1), (truth, 0)], "truth")
    plot.line(list(zip(candidates, prob_higher, strict=True)), "estimate")
    return plot


def learning_curve(run: RunData) -> Plot | None:
    """Returns against policy steps: one line for episodes on pictures, one for other episodes."""
    lines: dict[str, list[tuple[float, float]]] = {"estimate": [], "start": []}
    for entry in run.metrics:
        if is_number(earned := entry.get("return/simulated")):
            kind = "estimate" if entry.get("filmed") else "start"
            lines[kind].append((float(entry["step"]), earned))
    points = [point for line in lines.values() for point in line]
    if len(points) < 2:
        return None
    mean = run.object("return").get("mean")
    returns = [earned for _, earned in points] + ([mean] if is_number(mean) else [])
    x = Axis(0, max(step for step, _ in points), LEFT + 4, WIDTH - RIGHT - 4)
    y = value_axis([0.0, *returns], HEIGHT - BOTTOM, TOP, is_colour=False)
    plot = Plot("return against steps in simulation", x, y)
    plot.label_y(y.ticks(5))
    plot.label_x({t: f"{t / 1000:g}k" if t else "0" for t in x.ticks(4)}, "steps in simulation")
    if is_number(mean):
        plot.across(mean, "truth")
    for kind, drawn in lines.items():
        if drawn:
            plot.line(drawn, kind)
    return plot


def _known(run: RunData, name: str, *keys: str) -> list[float | None]:
    facts = run.parameters[name]
    return [value if is_number(value := facts.get(key)) else None for key in keys]


def _some(rounds: list[float], most: int = 6) -> list[float]:
    """At most `most` evenly spaced entries, always including the last."""
    stride = -(-len(rounds) // most)
    return rounds[::-1][::stride][::-1]


def _band(plot: Plot, spans: list[tuple[float, float, float]], kind: str) -> None:
    """Draw the area between low and high over rounds; a bar for a single round."""
    if len(spans) == 1:
        at, low, high = spans[0]
        plot.box((at, high), (at, low), kind, inset=-6)
    else:
        plot.area(
            [(r, high) for r, _, high in spans] + [(r, low) for r, low, _ in spans[::-1]], kind
        )
