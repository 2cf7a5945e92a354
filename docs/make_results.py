"""docs/results.md, made from docs/results/*.json, one table a claim: `python docs/make_results.py`.

A claim's file holds its title, `claim` (what was measured and how, the goal), `note` (what came
out, where it falls short), columns, and rows. Both texts are paragraphs on the page.
A row is one measurement: its figures, and `command`, `commit`, `date` and `hardware`, null where
unknown. `key` names the fields that tell rows apart. Benchmarks write rows (`--record FILE`);
everything else is written by hand.

A column's text is a format of a row's fields, such as "{percent_error:.1f} %". A dict is shown
name by name (where names share a text, text by text), a list item by item. A string in place of a
number is shown as it is, and a missing value as a dash. A column with `where` shows only the rows
whose fields have those values. Rows with the same `one_line_per` fields share a line, and `groups`
gives several values of a field one name. Of rows on a line a column shows all, or with `together`
their number, sum, range or most; or, of texts such as "5 %, ±9 % holds, weak", a tally.
"""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
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
    "torques",
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
VERDICTS = ("identified", "weak", "not identifiable")
_MOST_COMMANDS = 2  # of a claim on the page; its file has all
_MOST_PLACES = 3  # commits, and machines
_HEAD = """\
How far estimates were off, how often intervals held the truth, and how long it took: one table
for each claim. For a case of your own, `simtune tune TASK --out DIR` without `--real` tunes to a
simulated truth and scores itself.

How to read the tables: an interval *holds* if it contains the true value; otherwise it *misses*.
*Identified*, *weak* and *not identifiable* are simtune's verdicts, by how much of the range
searched first an interval still covers. *Known worlds* are simulated worlds that are filmed and
fitted like the real one, to judge a fit; such a fit is a *refit*. A *busy* core is shared with
other processes.

Below each text stand commands, dates, commits and hardware of its rows, the first few where they
differ; the JSON file has them for each row. The Intel Xeons are virtual machines (AVX-512, 24 GB,
no GPU) whose speed varies: compare times only within one run.

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
    for row in grouped(claim["rows"], claim.get("groups", {})):
        together = tuple(row[name] for name in claim.get("one_line_per", claim["key"]))
        lines.setdefault(together, []).append(row)
    cells = [[column["title"] for column in columns]]
    cells += [[cell(column, rows) for column in columns] for rows in lines.values()]
    head, *body = (f"| {' | '.join(line)} |" for line in cells)
    return "\n".join([head, "|" + "---|" * len(columns), *body])


def grouped(rows: Iterable[Row], groups: Mapping[str, Mapping[str, Sequence[Any]]]) -> list[Row]:
    """The rows, with the name of its group in place of a field's value."""
    names = {
        field: {value: name for name, values in its.items() for value in values}
        for field, its in groups.items()
    }
    return [
        {**row, **{field: its.get(row[field], row[field]) for field, its in names.items()}}
        for row in rows
    ]


def cell(column: Mapping[str, Any], rows: Iterable[Row]) -> str:
    """What the rows of one line say, each value once if all are the same."""
    where = column.get("where", {}).items()
    chosen = [row for row in rows if all(row[name] == value for name, value in where)]
    if "together" in column:
        return TOGETHER[column["together"]](column["text"], chosen)
    texts = [made for row in chosen if (made := fill(column["text"], row)) not in ("", MISSING)]
    return "; ".join(texts if len(set(texts)) > 1 else texts[:1]) or MISSING


def _number(_: str, rows: Sequence[Row]) -> str:
    return str(len(rows)) if rows else MISSING


def _sum(template: str, rows: Sequence[Row]) -> str:
    return _reduced(sum, template, rows)


def _range(template: str, rows: Sequence[Row]) -> str:
    return " to ".join(dict.fromkeys(_reduced(end, template, rows) for end in (min, max)))


def _most(template: str, rows: Sequence[Row]) -> str:
    return _reduced(max, template, rows)


def _reduced(function: Callable[[list[Any]], Any], template: str, rows: Sequence[Row]) -> str:
    """The template with what the function makes of each field's values that are there."""
    names = [name for _, name, _, _ in Formatter().parse(template) if name]
    values = {name: [row[name] for row in rows if row.get(name) is not None] for name in names}
    return fill(template, {name: function(its) for name, its in values.items() if its})


def _tally(template: str, rows: Sequence[Row]) -> str:
    """The errors' range, how many of the intervals given hold, and how many verdicts there are."""
    texts = [made for row in rows if (made := fill(template, row)) != MISSING]
    errors = [float(found[1]) for text in texts if (found := re.match(r"([\d.]+) %", text))]
    if not errors:
        return "; ".join(texts) or MISSING
    if all(text.endswith(VERDICTS[-1]) for text in texts):
        return VERDICTS[-1]
    held, missed = (sum(word in text for text in texts) for word in ("holds", "misses"))
    verdicts = Counter(text.split(", ")[-1] for text in texts)
    parts = [" to ".join(dict.fromkeys(f"{end(errors):g}" for end in (min, max))) + " %"]
    parts += [f"{held} of {held + missed} hold"] if held + missed else []
    counts = [(verdicts[word], word) for word in VERDICTS if verdicts[word]]
    parts += [word if count == len(texts) else f"{count} {word}" for count, word in counts]
    return ", ".join(parts)


TOGETHER: dict[str, Callable[[str, Sequence[Row]], str]] = {
    "number": _number,
    "sum": _sum,
    "range": _range,
    "most": _most,
    "tally": _tally,
}


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
        if isinstance(value, dict) and _has_shared_words(value):
            return _by_words(value)
        if isinstance(value, dict):
            return ", ".join(f"{key} {fill(template, {name: v})}" for key, v in value.items())
        if isinstance(value, list):
            return ", ".join(fill(template, {name: v}) for v in value)
    filled = template.format(**dict(zip(names, values, strict=True)))
    return re.sub(r"(?<=\d)%", " %", filled)


def _has_shared_words(value: Mapping[str, Any]) -> bool:
    words = value.values()
    return all(isinstance(word, str) for word in words) and len(set(words)) < len(value)


def _by_words(value: Mapping[str, str]) -> str:
    """Verdicts, say: each once, with the names of all that have it."""
    names: dict[str, list[str]] = {}
    for name, word in value.items():
        names.setdefault(word, []).append(name)
    if len(names) == 1:
        return f"all {next(iter(names))}"
    return "; ".join(f"{word}: {', '.join(its)}" for word, its in names.items())


def origin(name: str, rows: Sequence[Row]) -> str:
    """A sentence: how, when, at which commits and on what the rows were measured."""
    commands = [f"`{command}`" for command in distinct(rows, "command")]
    if len(commands) > _MOST_COMMANDS:
        commands = [f"{commands[0]} and others"]
    commits = dict.fromkeys(c for commit in distinct(rows, "commit") for c in commit.split(", "))
    dates = distinct(rows, "date")
    parts = [
        f"Measured by {', '.join(commands)}" if commands else "",
        " to ".join(dict.fromkeys(end(dates) for end in (min, max))) if dates else "",
        f"commit {some(list(commits), ', ')}" if commits else "",
        some(distinct(rows, "hardware"), " / "),
        f"[{name}.json](results/{name}.json).",
    ]
    return "; ".join(filter(None, parts))


def some(items: Sequence[str], separator: str) -> str:
    """The first of them, and how many others there are."""
    others = f" and {len(items) - _MOST_PLACES} more" if len(items) > _MOST_PLACES else ""
    return separator.join(items[:_MOST_PLACES]) + others


def distinct(rows: Iterable[Row], field: str) -> list[str]:
    """A field's different values, in the rows' order."""
    return list(dict.fromkeys(row[field] for row in rows if row[field] is not None))


if __name__ == "__main__":
    (DOCS / "results.md").write_text(page(), encoding="utf-8")
