"""docs/results.md, made from docs/results/*.json, one table a claim: `python docs/make_results.py`.

A claim's file holds its title, `claim` (what was measured and how, the goal), `note` (what came
out, where it falls short), columns, and rows. Both texts are paragraphs on the page.
A row is one measurement: its figures, and `command`, `commit`, `date` and `hardware`, null where
unknown. `key` names the fields that tell rows apart. Benchmarks write rows (`--record FILE`);
everything else is written by hand.

A column's text is a format of a row's fields, such as "{percent_error:.1f} %". A dict is shown
name by name, a list item by item. A string in place of a number is shown as it is, and a missing
value as a dash. A column with `where` shows only the rows whose fields have those values. Rows with
the same `one_line_per` fields share a line.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from string import Formatter
from typing import Any

DOCS = Path(__file__).parent
ORDER = (  # on the page; other claims follow
    "accuracy",
    "far",
    "gap",
    "colours",
    "peers",
    "policies",
    "whole_runs",
    "recordings",
    "pendulums",
    "clutter",
    "servos",
    "arms",
    "balancing",
    "flying",
    "motions",
    "aloha",
    "two_cameras",
    "camera_pose",
    "head_camera",
    "honesty",
    "robot_limits",
    "memory",
    "precision",
    "speed",
    "gpu",
    "meshes",
    "suite",
)
MISSING = "–"
_MOST_COMMANDS = 2  # of a claim on the page; its file has all
_HEAD = """\
How far estimates were off, how often intervals held the truth, and how long it took: one table
for each claim. For a case of your own, `simtune tune TASK --out DIR` without `--real` tunes to a
simulated truth and scores itself.

How to read the tables: an interval *holds* if it contains the true value; otherwise it *misses*.
*Identified*, *weak* and *not identifiable* are simtune's verdicts, by how much of the range
searched first an interval still covers. *Known worlds* are simulated worlds that are filmed and
fitted like the real one, to judge a fit; such a fit is a *refit*. A *busy* core is shared with
other processes.

Below each text stand the command, date, commit and hardware of the rows, at most two commands;
the JSON file has them for each row. The Intel Xeons are virtual machines (AVX-512, 24 GB, no GPU)
whose speed varies: compare times only within one run. Earlier measurements are in git's history.

This page is made from [docs/results](results) by `python docs/make_results.py`; edit the files
there."""

Claim = Mapping[str, Any]
Row = Mapping[str, Any]


def page(folder: Path = DOCS / "results") -> str:
    """All of results.md."""
    names = {path.stem for path in folder.glob("*.json")}
    ordered = [*(name for name in ORDER if name in names), *sorted(names - set(ORDER))]
    sections = (section(name, read(folder / f"{name}.json")) for name in ordered)
    return "\n\n".join(["# Results", _HEAD, *sections]) + "\n"


def read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def section(name: str, claim: Claim) -> str:
    texts = filter(None, [claim["claim"], claim["note"], origin(name, claim["rows"])])
    parts = [f"## {claim['title']}", *texts, table(claim)]
    if "picture" in claim:
        parts.append(f"![{claim['picture_text']}]({claim['picture']})")
    return "\n\n".join(parts)


def table(claim: Claim) -> str:
    columns = claim["columns"]
    lines: dict[tuple[Any, ...], list[Row]] = {}
    for row in claim["rows"]:
        together = tuple(row[name] for name in claim.get("one_line_per", claim["key"]))
        lines.setdefault(together, []).append(row)
    cells = [[column["title"] for column in columns], ["---"] * len(columns)]
    cells += [[cell(column, rows) for column in columns] for rows in lines.values()]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def cell(column: Mapping[str, Any], rows: Iterable[Row]) -> str:
    """What the rows of one line say, each value once if all are the same."""
    where = column.get("where", {}).items()
    chosen = (row for row in rows if all(row[name] == value for name, value in where))
    texts = [made for row in chosen if (made := fill(column["text"], row)) != MISSING]
    return "; ".join(texts if len(set(texts)) > 1 else texts[:1]) or MISSING


def fill(template: str, row: Row) -> str:
    """The template with a row's figures."""
    names = [name for _, name, _, _ in Formatter().parse(template) if name]
    values = [row.get(name) for name in names]
    if None in values:
        return MISSING
    if len(names) == 1:
        (name,), (value,) = names, values
        if isinstance(value, str):
            return value
        if isinstance(value, dict):
            return ", ".join(f"{key} {fill(template, {name: v})}" for key, v in value.items())
        if isinstance(value, list):
            return ", ".join(fill(template, {name: v}) for v in value)
    filled = template.format(**dict(zip(names, values, strict=True)))
    return re.sub(r"(?<=\d)%", " %", filled)


def origin(name: str, rows: Sequence[Row]) -> str:
    """A sentence: how, when, at which commits and on what the rows were measured."""
    commands = [f"`{command}`" for command in distinct(rows, "command")]
    if len(commands) > _MOST_COMMANDS:
        commands = [f"{commands[0]} and others"]
    commits = dict.fromkeys(c for commit in distinct(rows, "commit") for c in commit.split(", "))
    parts = [
        f"Measured by {', '.join(commands)}" if commands else "",
        ", ".join(sorted(distinct(rows, "date"))),
        f"commit {', '.join(commits)}" if commits else "",
        " / ".join(distinct(rows, "hardware")),
        f"[{name}.json](results/{name}.json).",
    ]
    return "; ".join(filter(None, parts))


def distinct(rows: Iterable[Row], field: str) -> list[str]:
    """A field's different values, in the rows' order."""
    return list(dict.fromkeys(row[field] for row in rows if row[field] is not None))


if __name__ == "__main__":
    (DOCS / "results.md").write_text(page(), encoding="utf-8")
