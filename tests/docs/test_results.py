"""docs/results.md is what docs/make_results.py makes of docs/results/*.json.

`python docs/make_results.py` makes the page anew.
"""

import json
import re
import runpy
import sys
from pathlib import Path
from string import Formatter

import pytest

ROOT = Path(__file__).parents[2]
CLAIMS = sorted((ROOT / "docs" / "results").glob("*.json"))
MADE = runpy.run_path(str(ROOT / "docs" / "make_results.py"))


@pytest.fixture
def common(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import common

    return common


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def test_the_results_page_is_the_one_made_from_the_claims():
    assert (ROOT / "docs" / "results.md").read_text(encoding="utf-8") == MADE["page"]()


@pytest.mark.parametrize("path", CLAIMS, ids=lambda path: path.stem)
def test_every_row_of_a_claim_has_its_command_commit_date_and_hardware(path):
    claim = read(path)
    assert {"title", "claim", "note", "key", "columns", "rows"} <= set(claim)
    for row in claim["rows"]:
        assert {"command", "commit", "date", "hardware", *claim["key"]} <= set(row)
        assert row["command"] is None or row["command"].strip()
        assert row["hardware"] is None or row["hardware"].strip()
        assert row["commit"] is None or re.match(r"[0-9a-f]{7}", row["commit"])
        assert row["date"] is None or re.fullmatch(r"\d{4}-\d\d-\d\d", row["date"])


@pytest.mark.parametrize("path", CLAIMS, ids=lambda path: path.stem)
def test_rows_differ_in_their_key_and_columns_show_their_fields(path):
    claim = read(path)
    keys = [tuple(row[name] for name in claim["key"]) for row in claim["rows"]]
    assert len(set(keys)) == len(keys)
    fields = {name for row in claim["rows"] for name in row}
    for column in claim["columns"]:
        shown = {name for _, name, _, _ in Formatter().parse(column["text"]) if name}
        assert shown | set(column.get("where", {})) <= fields


def test_a_cell_shows_numbers_names_and_what_is_missing():
    fill, cell = MADE["fill"], MADE["cell"]
    assert fill("{error:.1f} %", {"error": 0.25}) == "0.2 %"
    assert fill("{held:.0%}", {"held": 0.9}) == "90 %"
    assert fill("{error:.1f} %", {"error": {"mass": 1.0, "gain": 2.0}}) == "mass 1.0 %, gain 2.0 %"
    assert fill("{held:.0%}", {"held": "9 of 10"}) == "9 of 10"
    assert fill("{low} to {high}", {"low": 1, "high": None}) == "–"
    rows = [{"method": "a", "x": 1}, {"method": "b", "x": 2}, {"method": "a", "x": 3}]
    assert cell({"text": "{x}", "where": {"method": "a"}}, rows) == "1; 3"


def test_rows_of_a_line_are_told_together():
    cell = MADE["cell"]
    rows = [{"task": "a", "of": 10, "s": 3.2}, {"task": "b", "of": 7, "s": None}]
    rows += [{"task": "c", "of": 8, "s": 5.0}]
    assert cell({"text": "{task}", "together": "number"}, rows) == "3"
    assert cell({"text": "{of} of them", "together": "sum"}, rows) == "25 of them"
    assert cell({"text": "{s:.1f} s", "together": "range"}, rows) == "3.2 s to 5.0 s"
    assert cell({"text": "{s:.1f}", "together": "range"}, rows[:1]) == "3.2"
    assert cell({"text": "{s:.1f}", "together": "most"}, rows) == "5.0"
    assert cell({"text": "{s}", "together": "most"}, rows[1:2]) == "–"
    assert cell({"text": "{s}", "together": "number", "where": {"task": "d"}}, rows) == "–"


def test_errors_intervals_and_verdicts_are_tallied():
    column = {"text": "{x}", "together": "tally"}

    def told(*texts: str) -> str:
        return MADE["cell"](column, [{"x": text} for text in texts])

    held, missed = "0.2 %, ±4 % holds, identified", "7.6 %, ±5 % **misses**, weak"
    assert told(held) == "0.2 %, 1 of 1 hold, identified"
    assert told(held, missed) == "0.2 to 7.6 %, 1 of 2 hold, 1 identified, 1 weak"
    unknown = "90.0 %, not identifiable"
    assert told(unknown, unknown) == "not identifiable"
    some = "0.2 to 90 %, 1 of 1 hold, 1 identified, 1 not identifiable"
    assert told(held, unknown) == some
    assert told("12 s") == "12 s"


def test_a_group_stands_in_place_of_its_values_and_shared_words_are_told_once():
    rows = [{"p": "kp", "x": 1}, {"p": "kv", "x": 2}, {"p": "mass", "x": 3}]
    named = MADE["grouped"](rows, {"p": {"servo": ["kp", "kv"]}})
    assert [row["p"] for row in named] == ["servo", "servo", "mass"]
    assert [row["x"] for row in named] == [1, 2, 3]
    fill = MADE["fill"]
    assert fill("{v}", {"v": {"a": "weak", "b": "weak"}}) == "all weak"
    assert fill("{v}", {"v": {"a": "weak", "b": "no", "c": "weak"}}) == "weak: a, c; no: b"
    assert fill("{v}", {"v": {"a": "weak", "b": "no"}}) == "a weak, b no"


def test_where_rows_come_from_is_told_in_short():
    def row(i: int, date: str | None) -> dict:
        where = {"commit": f"{i}, a", "hardware": f"machine {i}"}
        return {"command": "run", "date": date} | where

    rows = [row(i, date) for i, date in enumerate(["2026-11-25", "2026-11-23", None, "2026-11-24"])]
    assert MADE["origin"]("claim", rows[:1]) == (
        "Measured by `run`; 2026-11-25; commit 0, a; machine 0; [claim.json](results/claim.json)."
    )
    assert MADE["origin"]("claim", rows) == (
        "Measured by `run`; 2026-11-23 to 2026-11-25; commit 0, a, 1 and 2 more; "
        "machine 0 / machine 1 / machine 2 and 1 more; [claim.json](results/claim.json)."
    )


def test_a_benchmark_replaces_its_row_and_keeps_the_others(common, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", [str(ROOT / "benchmarks" / "memory.py"), "--task", "walker"])
    path = tmp_path / "claim.json"
    common.record_figures(
        path, ("task",), [{"task": "walker", "mb": 2}, {"task": "finger", "mb": 3}]
    )
    first = read(path)
    first["rows"][0]["goal"] = "4"
    path.write_text(json.dumps(first | {"title": "Memory"}), encoding="utf-8")
    common.record_figures(
        path, ("task",), [{"task": "walker", "mb": 1}, {"task": "cheetah", "mb": 5}]
    )
    claim = read(path)
    assert claim["title"] == "Memory"
    assert [(row["task"], row["mb"]) for row in claim["rows"]] == [
        ("walker", 1),
        ("finger", 3),
        ("cheetah", 5),
    ]
    assert claim["rows"][0]["goal"] == "4"
    assert claim["rows"][0]["command"] == "python benchmarks/memory.py --task walker"
    assert re.search(r"\d of \d+ cores", claim["rows"][0]["hardware"])
    assert "| walker | 1 |" in MADE["table"](claim)


def test_nothing_is_recorded_unless_asked_for(common, monkeypatch):
    monkeypatch.setattr(common, "_origin", lambda: pytest.fail("nothing is looked up"))
    common.record_figures(None, ("task",), [{"task": "walker"}])
