"""The report's table of the parameters, and swatches of the colours among them."""

from typing import Any

from simtune.report.data import RunData
from simtune.report.words import MISSING, interval, number, percent, text, unit
from simtune.validate import is_number

_VERDICTS = ("identified", "weak", "not identifiable")


def parameters(run: RunData) -> str:
    """What was found of each of them; of a run that tunes nothing, the worlds it was trained in."""
    shown = f"{_table(run)}{_colours(run)}" if run.is_tuned else _worlds(run)
    return f"<section><h2>Parameters</h2>{shown}</section>"


def _worlds(run: RunData) -> str:
    rows = []
    for name, p in run.parameters.items():
        range_ = interval(p.get("low"), p.get("high")) or MISSING
        numbers = [number(p.get("nominal")), range_, number(p.get("real"))]
        rows.append([text(name), _unit(p), *numbers])
    return _rows(["Parameter", "Unit", "Nominal", "Worlds trained in", "Truth"], rows)


def _table(run: RunData) -> str:
    """One row a parameter."""
    parameters = run.parameters
    if not parameters:
        return "<p>No estimate has been made yet.</p>"
    has_truth = any(is_number(p.get("real")) for p in parameters.values())
    heads = ["Parameter", "Unit", "Nominal", "Start", "Estimate", "90 % interval", "Verdict"]
    heads += ["Truth", "Error"] if has_truth else []
    rows = []
    for name, p in parameters.items():
        cells = [
            _unit(p),
            number(p.get("nominal")),
            number(p.get("initial")),
            f"<b>{number(p.get('mean'))}</b>",
            interval(p.get("low"), p.get("high")) or MISSING,
            chip(p.get("verdict")),
        ]
        if has_truth:
            cells += [number(p.get("real")), percent(p.get("percent_error"))]
        rows.append([text(name), *cells])
    return _rows(heads, rows)


def _unit(p: dict[str, Any]) -> str:
    return text(p.get("unit")) if unit(p.get("unit")) else MISSING


def _rows(heads: list[str], rows: list[list[str]]) -> str:
    """A table; the first cell of a row is its head."""
    lines = []
    for first, *rest in rows:
        cells = [f"<td data-head='{h}'>{c}</td>" for h, c in zip(heads[1:], rest, strict=True)]
        lines.append(f"<tr><th scope='row'>{first}</th>{''.join(cells)}</tr>")
    head = "".join(f"<th scope='col'>{h}</th>" for h in heads)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def chip(verdict: Any) -> str:
    if verdict is None:
        return "<span class='chip open'>open</span>"
    kind = str(verdict).replace(" ", "-") if verdict in _VERDICTS else "open"
    return f"<span class='chip {kind}'>{text(verdict)}</span>"


def _colours(run: RunData) -> str:
    """Swatches of each colour triple: start, estimate, truth."""
    rows = []
    for name in run.colours:
        swatches = []
        for key, label in (("initial", "start"), ("mean", "estimate"), ("real", "truth")):
            given = (run.parameters[f"{name}_{c}"].get(key) for c in "rgb")
            rgb = [value for value in given if is_number(value)]
            if len(rgb) == 3:
                shade = ",".join(str(round(255 * min(max(v, 0), 1))) for v in rgb)
                swatches.append(
                    f"<div><i style='background:rgb({shade})'></i><span>{label}</span></div>"
                )
        if swatches:
            rows.append(f"<div class='colour'><b>{text(name)}</b>{''.join(swatches)}</div>")
    return f"<h3>Colours</h3><div class='colours'>{''.join(rows)}</div>" if rows else ""
