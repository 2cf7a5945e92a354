"""The figures that benchmarks/whole_runs.py and precision.py make of hand-made lines."""

import json
from pathlib import Path

import pytest
from run_lines import NAMES, SPACE, a_line, whole_run

from simtune.parameters import ParameterSpace

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _as_a_script_finds_them(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


def test_a_run_is_scored_in_percent_of_its_truth():
    from whole.lines import scored
    from whole.run import Ended

    entry = {"mean": 0.51, "low": 0.5, "high": 0.52, "real": 0.5, "percent_error": 2.00004}
    parameters = {name: entry | {"verdict": "weak"} for name in NAMES}
    parameters["pole_mass"] = entry | {"low": 0.501, "verdict": "identified"}
    result = {"parameters": parameters, "warnings": ["look"], "percent_error": 2.0}
    rounds = [(20.0, {"is_early": 1.0}), (30.0, {"round": 1}), (60.0, {"round": 2})]
    line = scored(Ended(61.234, rounds, result, None), SPACE)
    assert (line["wall_s"], line["rounds"], line["warnings"]) == (61.2, 2, ["look"])
    assert line["errors"]["body_r"] == 2.0
    assert line["half_widths"]["body_r"] == pytest.approx(2.0)  # .01 of .5
    assert line["half_widths"]["pole_mass"] == pytest.approx(1.9)
    assert line["holds"] == {name: name != "pole_mass" for name in NAMES}
    assert line["verdicts"]["pole_mass"] == "identified"
    assert len(json.dumps(line)) < 1500


def test_a_summary_counts_intervals_runs_and_lateness():
    from whole.summary import summary

    lines = [
        a_line(held=8, error=1.0),
        a_line(whole_run(cores=2), held=3, error=2.0, wall_s=406.0),  # 1.1 · 360 + 10 s
        a_line(held=3, error=12.0, warnings=["look"], wall_s=406.1),
        a_line(held=4, error=20.0, verdict="weak"),
        whole_run(seed=9).settings | {"failed": "exit status 1: simtune: no"},
    ]
    lines[0]["errors"]["pole_mass"] = 4.0
    found = summary(lines, SPACE)
    assert (found["runs"], found["failed"], found["late"]) == (4, 1, 1)
    assert found["coverage"] == pytest.approx(18 / 32, abs=1e-3)
    assert found["coverage_by_cores"] == {"1": 0.625, "2": 0.375}
    assert found["coverage_of_each"][NAMES[3]] == 0.5
    assert found["lowest"] == {NAMES[4]: 0.25}
    assert found["wrong_unwarned"] == 0.25, "the second: a half is not fewer, the third warned"
    assert found["warned"] == 0.25
    assert found["identified_far_off"] == [f"{name} of 3: 12.0 %" for name in NAMES]
    assert found["dynamics_percent_error"] == 8.0  # of 4 1 2 2 12 12 20 20
    assert found["colours_percent_error"] == 7.0
    assert found["wall_to_budget"] == pytest.approx(406.1 / 360, abs=1e-3)


def test_a_summary_of_failures_alone_has_no_figures():
    from whole.summary import failures, summary

    line = whole_run().settings | {"failed": "exit status 1: simtune: no"}
    assert summary([line], SPACE) == {"runs": 0, "failed": 1}
    assert failures([line, a_line()]) == ["cartpole 3: exit status 1: simtune: no"]


def a_row(space: ParameterSpace, truth: dict[str, float], factor: float) -> dict[str, float]:
    """A round that finds `factor` times the truth, to 2 %."""
    found = {name: factor * value for name, value in truth.items()}
    return {
        f"{column}/{name}": value * scale
        for name, value in found.items()
        for column, scale in (("mean", 1.0), ("low", 0.98), ("high", 1.02))
    }


def test_a_round_is_scored_by_its_mean_error_and_intervals():
    from precision import scored_round

    truth = dict.fromkeys(NAMES, 0.5)
    row = a_row(SPACE, truth, 1.01)
    scored = {"s": 12.3, "percent_error": 1.0, "held": 8, "is_judged": True}
    assert scored_round(12.34, row, SPACE, truth) == scored
    assert not scored_round(12.34, row | {"is_early": 1.0}, SPACE, truth)["is_judged"]
    assert scored_round(1.0, a_row(SPACE, truth, 1.03), SPACE, truth)["held"] == 0
    for missing in (None, float("nan"), float("inf")):
        assert scored_round(1.0, row | {"low/pole_mass": missing}, SPACE, truth)["held"] is None


def followed_line(rounds, wall_s=200.0, **changes) -> dict:
    keys = ("s", "percent_error", "held", "is_judged")
    rounds = [values if len(values) == len(keys) else (*values, True) for values in rounds]
    rows = [dict(zip(keys, values, strict=True)) for values in rounds]
    line = whole_run(**changes).settings | {"commit": "1234567", "date": "2026-11-22"}
    return line | {"rounds": rows, "wall_s": wall_s, "percent_error": 0.4, "held": 7, "of": 8}


def test_a_world_is_known_at_the_first_round_that_is_near_and_has_intervals():
    from precision import known_at

    line = followed_line([(10, 3.0, 8), (20, 0.9, None), (30, 1.0, 6, False), (40, 0.5, 8)])
    assert known_at(line, 1.0)["s"] == 30
    assert known_at(line, 1.0, judged=True)["s"] == 40
    assert known_at(line, 0.6)["s"] == 40
    assert known_at(line, 0.1) is None


def test_precision_is_the_median_and_a_world_that_is_never_known_the_slowest():
    from precision import summary

    lines = [
        followed_line([(60, 0.8, 8)], wall_s=100.0),
        followed_line([(90, 0.8, 4)], wall_s=300.0, seed=4),
        followed_line([(50, 5.0, 8)], wall_s=200.0, seed=5),
        whole_run(seed=6).settings | {"failed": "exit status 1: simtune: no"},
    ]
    found = summary(lines, 1.0)
    assert (found["worlds"], found["failed"], found["reached"]) == (3, 1, "2 of 3")
    assert (found["seconds"], found["goal_s"], found["ratio"]) == (90.0, 120, 0.75)
    assert found["returned_s"] == 200.0
    assert found["held_then"] == 0.75
    assert found["held"] == 0.875
    none = summary(lines[2:3], 1.0)
    assert (none["reached"], none["seconds"], none["ratio"]) == ("0 of 1", None, None)
    assert none["held_then"] is None


def test_lines_that_are_there_are_summarized_and_recorded(tmp_path, capsys):
    from whole.lines import Lines
    from whole_runs import main

    known = Lines(tmp_path)
    for seed in range(4):  # runs of even numbers have one core
        run = whole_run(seed=seed, cores=1 + seed % 2)
        known.append("cartpole", a_line(run, held=8 - seed) | {"commit": f"{seed % 2}abcdef"})
    known.append("cartpole", a_line(whole_run(seed=0, minutes=5.0), held=0))
    record = tmp_path / "claim.json"
    main(("cartpole",), 3, cores_per_run="half", lines=tmp_path, show=True, record=record)
    (task,) = json.loads(capsys.readouterr().out.splitlines()[-1])["tasks"]
    assert (task["runs"], task["coverage"]) == (3, 0.875)
    assert task["coverage_by_cores"] == {"1": 0.875, "2": 0.875}
    (row,) = json.loads(record.read_text())["rows"]
    assert (row["coverage"], row["commit"]) == (0.875, "0abcdef, 1abcdef"), "the lines' commits"


def test_failed_runs_are_named_at_the_end(tmp_path, capsys):
    from whole.lines import Lines
    from whole_runs import main

    failed = whole_run(seed=0).settings | {"failed": "exit status 1: simtune: no"}
    Lines(tmp_path).append("cartpole", failed)
    with pytest.raises(SystemExit, match="1"):
        main(("cartpole",), 1, out=tmp_path)  # which would take minutes, were it run again
    assert capsys.readouterr().err.endswith("failed: cartpole 0: exit status 1: simtune: no\n")
