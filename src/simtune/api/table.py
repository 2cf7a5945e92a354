"""Estimates as a table, in plain text and in HTML for notebooks."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from simtune.columns import aligned
from simtune.report.words import MISSING, covered, interval, interval_label, number, percent, unit
from simtune.validate import is_number

Rows = Sequence[Sequence[str]]
_TEXTS = ("parameter", "unit", "verdict")  # left-aligned; numbers are right-aligned
_CELL = "<{0} style='text-align:{1}'>{2}</{0}>"


def lines(parameters: Mapping[str, Mapping[str, Any]], search: str | None) -> list[str]:
    """Lines of plain text, from result.json's facts on each parameter.

    `search`: how the run searched for parameters; None if it did not.
    """
    rows = table_rows(parameters, search)
    return aligned(rows, left=[i for i, name in enumerate(rows[0]) if name in _TEXTS])


def html(parameters: Mapping[str, Mapping[str, Any]], search: str | None) -> str:
    """The same table as HTML."""
    head, *rows = table_rows(parameters, search)

    def line(tag: str, row: Sequence[str]) -> str:
        aligns = ("left" if name in _TEXTS else "right" for name in head)
        cells = (_CELL.format(tag, a, escape(c)) for a, c in zip(aligns, row, strict=True))
        return f"<tr>{''.join(cells)}</tr>"

    body = "\n".join(line("td", row) for row in rows)
    return f"<table>\n<thead>{line('th', head)}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def table_rows(parameters: Mapping[str, Mapping[str, Any]], search: str | None) -> Rows:
    """Texts of the cells: the head, then one row per parameter."""
    is_known = any(is_number(p.get("real")) for p in parameters.values())
    has_intervals = search == "posterior"
    named = ("estimate" if search else "mean", interval_label(search))
    named += ("of first range",) * has_intervals + ("verdict",) * bool(search)
    heads = ("parameter", "unit", "start", *named, *("truth", "off by") * is_known)
    rows: list[tuple[str, ...]] = [heads]
    for name, p in parameters.items():
        cells = [name, unit(p), number(p["initial"]), number(p["mean"]), interval(p)]
        its_share = p.get("interval_share")
        cells += [covered(its_share) if is_number(its_share) else MISSING] * has_intervals
        cells += [str(p.get("verdict"))] * bool(search)
        cells += [number(p.get("real")), percent(p.get("percent_error"))] * is_known
        rows.append(tuple(cells))
    return rows
