"""Estimates as a table, in plain text and in HTML for notebooks."""

from collections.abc import Container, Mapping, Sequence
from html import escape
from typing import Any

from simtune.columns import aligned
from simtune.names import search_traits
from simtune.report.words import (
    MISSING,
    as_precise,
    covered,
    interval,
    interval_label,
    not_looked_at,
    number,
    percent,
    unit,
)
from simtune.run_data import RunData
from simtune.validate import is_number

Rows = Sequence[Sequence[str]]
_TEXTS = ("parameter", "unit", "verdict")  # left-aligned; numbers are right-aligned
_CELL = "<{0} style='text-align:{1}'>{2}</{0}>"


def lines(run: RunData) -> list[str]:
    """Lines of plain text; parameters that nobody looked at are one line."""
    rows = table_rows(run.looked_at, run.search, run.known)
    left = [i for i, name in enumerate(rows[0]) if name in _TEXTS]
    return [*aligned(rows, left=left), *filter(None, [not_looked_at(run.not_looked_at)])]


def html(run: RunData) -> str:
    """The same table as HTML."""
    head, *rows = table_rows(run.looked_at, run.search, run.known)

    def line(tag: str, row: Sequence[str]) -> str:
        aligns = ("left" if name in _TEXTS else "right" for name in head)
        cells = (_CELL.format(tag, a, escape(c)) for a, c in zip(aligns, row, strict=True))
        return f"<tr>{''.join(cells)}</tr>"

    body = "\n".join(line("td", row) for row in rows)
    table = f"<table>\n<thead>{line('th', head)}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"
    said = not_looked_at(run.not_looked_at)
    return table + f"\n<p>{escape(said)}</p>" * bool(said)


def table_rows(
    parameters: Mapping[str, Mapping[str, Any]], search: str | None, known: Container[str] = ()
) -> Rows:
    """Texts of the cells: the head, then one row per parameter.

    `parameters`: result.json's facts on each; `search`: how the run searched for them, if it did;
    `known`: colours that were not searched, which have neither interval nor verdict.
    """
    has_truth = any(is_number(p.get("real")) for p in parameters.values())
    has_intervals = search_traits(search).has_intervals
    named = ("estimate" if search else "mean", interval_label(search))
    named += ("of first range",) * has_intervals + ("verdict",) * bool(search)
    heads = ("parameter", "unit", "start", *named, *("truth", "off by") * has_truth)
    rows: list[tuple[str, ...]] = [heads]
    for name, p in parameters.items():
        p = {**p, "low": None, "high": None, "interval_share": None} if name in known else p
        interval_of = p if has_intervals else {}
        mean = as_precise(p["mean"], interval_of)
        cells = [name, unit(p), number(p["initial"]), mean, interval(p)]
        its_share = p.get("interval_share")
        cells += [covered(its_share) if is_number(its_share) else MISSING] * has_intervals
        cells += ["known" if name in known else str(p.get("verdict"))] * bool(search)
        truth = as_precise(p.get("real"), interval_of)
        cells += [truth, percent(p.get("percent_error"))] * has_truth
        rows.append(tuple(cells))
    return rows
