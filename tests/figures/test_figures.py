"""Figures of many runs, from tiny run folders made by hand."""

import csv
import json
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from simtune.errors import InputError
from simtune.figures import write_figures
from simtune.figures.authors import AUTHORS
from simtune.figures.curves import interpolated, stepped
from simtune.figures.draw import LEGEND, draw
from simtune.figures.gather import figures_of
from simtune.figures.groups import Setting, settings
from simtune.figures.raster import png
from simtune.figures.records import read_records
from simtune.figures.statistics import centre, stratified
from simtune.figures.tables import authors, overall, rows, shares_of_oracle


def make_run(
    folder: Path,
    method: str = "autotune",
    seed: int = 0,
    *,
    returned: float = 700.0,
    task: str = "ball_in_cup",
    rounds: tuple[tuple[int, float], ...] = ((5, 1.2), (7, 1.1)),
    **options: object,
) -> Path:
    """A training that ends; `rounds`: real episodes, and the mean of a mass that is 1."""
    path = folder / f"{task}-{method}-{seed}-{'-'.join(map(str, options.values()))}"
    path.mkdir(parents=True)
    config = {"task": task, "method": method, "seed": seed, "out": str(path), "real_gap": False}
    config |= {"real_episodes": None, "real": "pseudo", "truth": str(seed)} | options
    (path / "config.json").write_text(json.dumps({"config": config}))
    lines = [{"step": 0, "real_episodes": n, "round": i, "mean/mass": m} for i, (n, m) in
             enumerate(rounds, 1)]  # fmt: skip
    lines += [
        {"step": step, "real_episodes": 7, "filmed": float(step > 100), "return/simulated": step}
        for step in (100, 200, 400)
    ]
    (path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    mass = {"initial": 2.0, "mean": rounds[-1][1], "real": 1.0, "percent_error": 10.0}
    result = {"task": task, "method": method, "seed": seed, "parameters": {"mass": mass}}
    result |= {"return": {"mean": returned, "std": 5.0, "episodes": 10}, "policy_steps": 400}
    result |= {"percent_error": 100 * abs(rounds[-1][1] - 1), "real_episodes": rounds[-1][0]}
    (path / "result.json").write_text(json.dumps(result | {"wall_s": 600.0, "sim_steps": 1000}))
    return path


def found(folder: Path) -> list[Setting]:
    return settings(read_records(folder)[0])


# --- statistics ---------------------------------------------------------------------------


def test_interquartile_mean_leaves_out_a_quarter_on_either_side():
    assert centre([0, 1, 2, 3, 4, 5, 6, 100]).mean == (2 + 3 + 4 + 5) / 4
    assert centre([1, 2, 6]).mean == 3  # of three none can go
    assert centre([1, 2, 3, 90]).mean == 2.5


def test_the_interval_of_fewer_than_five_seeds_is_from_the_lowest_to_the_highest(tmp_path):
    assert centre([0, 10])[:3] == (5, 0, 10)
    assert centre([3, 0, 100, 5])[:3] == (4, 0, 100)
    of_five = centre([3, 0, 100, 5, 4])
    assert of_five.low > 0
    assert of_five.high < 100
    make_run(tmp_path)
    assert "run from the lowest seed to the highest; of five" in write_figures(tmp_path).read_text()


def test_a_bracket_whose_ends_read_alike_is_left_out(tmp_path):
    for seed in (0, 1):
        path = make_run(tmp_path, "oracle", seed, task="rope_peg", returned=-20 - seed)
        result = json.loads((path / "result.json").read_text())
        result["success"] = {"mean": 1.0, "std": 0.0, "episodes": 10}
        (path / "result.json").write_text(json.dumps(result))
    page = write_figures(tmp_path).read_text()
    assert "<td data-head='Success'><span>100 %</span></td>" in page
    assert "-20.5 <small>[-21.0, -20.0]</small>" in page
    assert f"<h1>Runs of {tmp_path.name}</h1>" in page


def test_a_single_seed_has_no_interval():
    alone = centre([3.0])
    assert alone.mean == 3
    assert math.isnan(alone.low)
    assert alone.num == 1


def test_intervals_agree_with_a_bootstrap_written_plainly():
    rng = np.random.default_rng(1)
    values = rng.normal(100, 10, 12)
    means = []
    for _ in range(20_000):
        drawn = np.sort(rng.choice(values, 12))
        means.append(drawn[3:9].mean())
    low, high = np.percentile(means, [2.5, 97.5])
    ours = centre(list(values))
    assert (ours.low, ours.high) == pytest.approx((low, high), abs=0.6)


def test_seeds_are_drawn_within_their_tasks():
    """Two tasks far apart: how they differ is no uncertainty of the seeds."""
    apart = stratified([[0.0, 0.0, 0.0], [100.0, 100.0, 100.0]])
    assert apart[:3] == (50, 50, 50)
    assert stratified([[0.0, 2.0], [10.0]])[:3] == (4, pytest.approx(10 / 3), pytest.approx(14 / 3))


# --- curves -------------------------------------------------------------------------------


def test_an_estimate_holds_until_the_next_one():
    band = stepped([[(0, 60), (5, 10)], [(0, 40), (5, 30), (5, 20), (7, 10)], []])
    assert [(x, c.mean) for x, c in band] == [(0, 50), (5, 15), (7, 10)]


def test_a_seed_that_has_not_begun_is_not_made_up():
    assert [x for x, _ in stepped([[(0, 1), (5, 1)], [(3, 1)]])] == [3, 5]


def test_smooth_curves_are_compared_where_all_seeds_are():
    band = interpolated([[(0, 0), (10, 10)], [(2, 0), (6, 8)]])
    assert (band[0][0], band[-1][0]) == (2, 6)
    assert band[0][1].mean == pytest.approx((2 + 0) / 2)
    assert band[-1][1].mean == pytest.approx((6 + 8) / 2)
    assert interpolated([[(0, 0), (1, 1)], [(2, 0), (3, 1)]]) == []


# --- runs and settings --------------------------------------------------------------------


def test_percent_error_on_the_way_is_that_of_the_result(tmp_path):
    make_run(tmp_path)
    (record,) = read_records(tmp_path)[0]
    errors = record.percent_errors()
    assert [x for x, _ in errors] == [0, 5, 7]
    assert [y for _, y in errors] == pytest.approx([100, 20, 10])
    assert errors[-1][1] == pytest.approx(record.result["percent_error"])


def test_a_truth_near_zero_counts_as_a_hundredth_of_the_bound(tmp_path):
    path = make_run(tmp_path)
    result = json.loads((path / "result.json").read_text())
    result["parameters"]["mass"] |= {"real": 0.0, "initial": 0.1}
    bounds = {"name": "mass", "low": -4.0, "high": 2.0}
    result["covariance"] = {"coordinates": [bounds]}
    (path / "result.json").write_text(json.dumps(result))
    (record,) = read_records(tmp_path)[0]
    assert record.percent_errors()[0] == (0, pytest.approx(100 * 0.1 / 0.04))


def test_a_truth_of_zero_without_bounds_counts_as_its_result_scored_it(tmp_path):
    """As of the paper's search, which has no covariance."""
    path = make_run(tmp_path)
    result = json.loads((path / "result.json").read_text())
    mass = result["parameters"]["mass"]
    mass |= {"real": 0.0, "initial": 0.1, "percent_error": 100 * mass["mean"] / 0.04}
    (path / "result.json").write_text(json.dumps(result))
    (record,) = read_records(tmp_path)[0]
    assert record.percent_errors()[0] == (0, pytest.approx(100 * 0.1 / 0.04))
    mass |= {"mean": 0.0, "percent_error": 0.0}  # divided by who knows what
    (path / "result.json").write_text(json.dumps(result))
    (record,) = read_records(tmp_path)[0]
    assert record.percent_errors() == []
    result["parameters"]["size"] = {"initial": 2.0, "mean": 1.0, "real": 1.0, "percent_error": 0.0}
    (path / "result.json").write_text(json.dumps(result))
    (record,) = read_records(tmp_path)[0]
    assert record.percent_errors()[0] == (0, pytest.approx(100))


def test_config_json_without_options_is_damaged(tmp_path):
    (make_run(tmp_path) / "config.json").write_text('{"config": []}')
    with pytest.raises(InputError, match=r"is damaged: .*no options of a run"):
        read_records(tmp_path)


def test_unfinished_runs_and_pilots_are_left_out(tmp_path):
    make_run(tmp_path / "runs")
    (make_run(tmp_path / "runs", seed=1) / "result.json").unlink()
    make_run(tmp_path / "pilots", seed=2)
    records, unfinished = read_records(tmp_path)
    assert [record.config["seed"] for record in records] == [0]
    assert unfinished == ["ball_in_cup-autotune-1-"]


def test_methods_are_compared_where_all_else_is_usual(tmp_path):
    for seed in (0, 1):
        for method in ("oracle", "dr", "autotune"):
            make_run(tmp_path, method, seed)
    for episodes in (1, 10):
        make_run(tmp_path, "autotune", 0, real_episodes=episodes, returned=500 + episodes)
    make_run(tmp_path, "autotune", 0, real_gap=True)
    usual, gap = found(tmp_path)
    assert [group.method for group in usual.groups] == ["autotune", "dr", "oracle"]
    assert [len(group.runs) for group in usual.groups] == [2, 2, 2]
    (ablation,) = usual.ablations
    assert ablation.option == "real_episodes"
    assert usual.num_others == 0
    values = {value: group.scores("return") for value, group in ablation.groups}
    assert values == {None: [700, 700], 1: [501], 10: [510]}
    assert (gap.has_gap, gap.title, gap.key) == (
        True,
        "ball_in_cup, through the gap",
        "ball_in_cup-gap",
    )


def test_a_method_that_does_not_use_an_option_is_compared_with_those_that_do(tmp_path):
    for seed in (0, 1):
        make_run(tmp_path, "oracle", seed)
        make_run(tmp_path, "dr", seed)
        make_run(tmp_path, "autotune", seed, real_episodes=10)
    make_run(tmp_path, "autotune", 0, real_episodes=2)
    (setting,) = found(tmp_path)
    assert [group.method for group in setting.groups] == ["autotune", "dr", "oracle"]
    assert [group.num_seeds for group in setting.groups] == [2, 2, 2]
    assert [ablation.option for ablation in setting.ablations] == ["real_episodes"]


def test_a_page_says_what_makes_runs_no_plain_seeds(tmp_path):
    for version in ("v1", "v2"):
        make_run(tmp_path / version, task_content=version)
    (tmp_path / "linked").symlink_to(tmp_path / "v1")  # the same runs, which count once
    entries = [{"name": "lost", "status": "failed"}, {"name": "seen", "status": "done"}]
    (tmp_path / "sweep.json").write_text(json.dumps({"runs": entries}))
    entries.append({"name": "ball_in_cup-autotune-0-v1", "status": "waiting"})  # an old board
    (tmp_path / "sweep.json").write_text(json.dumps({"runs": entries}))
    records, unfinished = read_records(tmp_path)
    assert unfinished == ["lost"]
    (setting,) = settings(records)
    assert (len(setting.groups[0].runs), rows(setting)[0].seeds) == (2, 1)
    twice, versions = setting.notes
    assert "autotune: 2 runs of 1 seeds" in twice
    assert "of 2 versions of the task" in versions


def test_runs_of_a_task_with_a_slash_in_its_name_are_drawn(tmp_path):
    make_run(tmp_path, task="left-right")
    result = tmp_path / "left-right-autotune-0-" / "result.json"
    result.write_text(result.read_text().replace("left-right", "left/../right"))
    (setting,) = found(tmp_path)
    assert setting.key == "left_.._right"


def test_tasks_whose_names_are_alike_as_files_names_have_files_of_their_own(tmp_path):
    for name in ("a b", "a_b", "a?b"):
        make_run(tmp_path, task=name)
    drawn = found(tmp_path)
    assert [setting.key for setting in drawn] == ["a_b", "a_b-2", "a_b-3"]
    write_figures(tmp_path)
    written = {path.name for path in (tmp_path / "figures").iterdir()}
    assert {f"{figure.key}.csv" for s in drawn for figure in figures_of(s)} < written
    assert len([name for name in written if name.endswith("return-step.csv")]) == 3


def test_runs_of_a_version_with_fewer_options_are_seeds_of_the_same(tmp_path):
    make_run(tmp_path, seed=0)
    make_run(tmp_path, seed=1, known_colour=None, json=False, task_name="ball_in_cup")
    (setting,) = found(tmp_path)
    assert [run.config["seed"] for run in setting.groups[0].runs] == [0, 1]
    assert not setting.ablations


def test_searches_are_methods_and_what_differs_twice_is_counted(tmp_path):
    make_run(tmp_path, "autotune", 0)
    make_run(tmp_path, "autotune", 1)
    make_run(tmp_path, "autotune", 0, search="paper")
    make_run(tmp_path, "autotune", 0, search="paper", real_episodes=2)
    make_run(tmp_path, "autotune", 0, real_episodes=2, preset="paper")
    make_run(tmp_path, "autotune", 0, pretrain_steps=100, start_factor=1.5)
    usual, pretrained = found(tmp_path)
    assert [group.method for group in usual.groups] == ["autotune", "autotune, paper"]
    (ablation,) = usual.ablations
    assert [(value, group.method) for value, group in ablation.groups] == [
        (2, "autotune, paper"),
        (None, "autotune, paper"),
    ]
    assert usual.num_others == 1
    assert pretrained.key == "ball_in_cup-sim-to-real"


def test_the_oracle_is_its_own_measure_whatever_one_seed_earns(tmp_path):
    for seed, earned in enumerate([700, 700, 700, 700, 10]):
        make_run(tmp_path, "oracle", seed, returned=earned)
    (setting,) = found(tmp_path)
    (row,) = rows(setting)
    assert row.of_oracle is not None
    assert row.of_oracle.mean == pytest.approx(1)


def test_shares_of_the_oracle_by_hand(tmp_path):
    for seed, (ours, oracle) in enumerate([(630, 700), (720, 740)]):
        make_run(tmp_path, "autotune", seed, returned=ours)
        make_run(tmp_path, "oracle", seed, returned=oracle)
    (setting,) = found(tmp_path)
    autotune = setting.group("autotune")
    assert autotune is not None
    assert shares_of_oracle(setting, autotune) == [630 / 720, 1.0]
    (row, _) = rows(setting)
    assert row.score is not None
    assert row.score[:3] == (675, 630, 720)
    assert row.percent_error is not None
    assert row.percent_error.mean == pytest.approx(10)
    share = overall([setting])["autotune"]
    assert share.of_oracle.mean == pytest.approx((630 / 720 + 1) / 2)
    assert share.num_tasks == 1


def test_a_task_with_a_goal_is_judged_by_success(tmp_path):
    for seed, reached in enumerate((0.8, 1.0)):
        path = make_run(tmp_path, "autotune", seed, task="rope_peg", returned=-20)
        result = json.loads((path / "result.json").read_text())
        result["success"] = {"mean": reached, "std": 0.0, "episodes": 10}
        (path / "result.json").write_text(json.dumps(result))
    (setting,) = found(tmp_path)
    (row,) = rows(setting)
    assert (row.score, row.returned) == (centre([0.8, 1.0]), centre([-20, -20]))
    assert row.score.mean == pytest.approx(0.9)
    (figure,) = [f for f in figures_of(setting) if f.key == "rope_peg-success-step"]
    assert figure.references[0].value == 0.42
    assert "-20" in write_figures(tmp_path).read_text()


def test_figures_show_what_was_measured_and_the_authors_end(tmp_path):
    for seed, returned in enumerate((600, 700, 800)):
        make_run(tmp_path, "autotune", seed, returned=returned)
    make_run(tmp_path, "dr", 0, returned=100, rounds=((0, 2.0),))
    figures = {figure.key.removeprefix("ball_in_cup-"): figure for figure in
               figures_of(*found(tmp_path))}  # fmt: skip
    assert set(figures) == {"learning", "return-step", "return-real_episodes", "error"}
    learning = figures["learning"].series[0].band
    assert [(learning[0][0], learning[0][1].mean)] == [(200, 200)]  # what the teacher did is none
    (autotune,) = figures["return-real_episodes"].series
    assert [(x, c.mean, c.low, c.high) for x, c in autotune.band] == [(7, 700, 600, 800)]
    levels = {each.label: each.value for each in figures["return-real_episodes"].references}
    assert levels == {"dr": 100, "authors' autotune": 337}
    (error,) = figures["error"].series  # dr estimates nothing
    assert [(x, round(c.mean)) for x, c in error.band] == [(0, 100), (5, 20), (7, 10)]
    assert figures["error"].references[0].value == 33


def test_a_users_task_named_like_a_built_in_one_is_kept_apart(tmp_path):
    make_run(tmp_path)
    config = make_run(tmp_path, seed=1) / "config.json"
    stored = json.loads(config.read_text())
    stored["config"]["task"] = "/home/me/ball_in_cup.toml"
    config.write_text(json.dumps(stored))
    built_in, own = found(tmp_path)
    assert (built_in.task, own.task) == ("ball_in_cup", "ball_in_cup (own)")
    assert authors(built_in)
    assert not authors(own)
    drawn = {each.label for figure in figures_of(own) for each in figure.references}
    assert not any("authors" in label for label in drawn)
    assert built_in.key != own.key


def test_authors_numbers_are_those_of_the_reference():
    assert AUTHORS["walker"].methods["autotune"].mean == 132
    assert AUTHORS["rope_peg"].methods["autotune"].mean == 0.42
    assert all(set(task.methods) == {"oracle", "autotune", "dr"} for task in AUTHORS.values())


# --- files --------------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_page_and_files_are_written(tmp_path):
    for seed in (0, 1):
        make_run(tmp_path, "autotune", seed, returned=700 + seed)
        make_run(tmp_path, "oracle", seed, returned=710)
    make_run(tmp_path, "autotune", 0, preset="<other>")
    page = write_figures(tmp_path)
    text = page.read_text()
    assert page == tmp_path / "figures.html"
    assert not re.search(r"(src|href)=.http", text)  # it is read without a network
    assert "<other>" not in text
    assert "authors' autotune" in text
    with (tmp_path / "figures" / "ball_in_cup-return-step.csv").open() as file:
        (autotune, *_) = csv.DictReader(file)
    assert autotune == {
        "series": "autotune",
        "policy steps": "400.0",
        "mean": "700.5",
        "low": "700.0",
        "high": "701.0",
        "num": "2",
    }
    with (tmp_path / "figures" / "runs.csv").open() as file:
        assert {row["return"] for row in csv.DictReader(file)} == {"700", "700.0", "701", "710"}
    for svg in (tmp_path / "figures").glob("*.svg"):
        ElementTree.parse(svg)
        picture = svg.with_suffix(".png").read_bytes()
        assert picture.startswith(b"\x89PNG")
        width = int.from_bytes(picture[16:20], "big")
        assert width == 2 * 300


def test_a_picture_has_the_marks_where_the_plot_has_them(tmp_path):
    from matplotlib.image import imread

    make_run(tmp_path, "autotune", 0, returned=400)
    figures = figures_of(*found(tmp_path))
    plot = draw(next(figure for figure in figures if figure.key.endswith("return-step")))
    (dot,) = [mark for mark in plot.marks if mark.tag == "circle"]
    path = tmp_path / "plot.png"
    path.write_bytes(png(plot))
    at = [round(2 * (float(dot.attributes["cy"]) + LEGEND)), round(2 * float(dot.attributes["cx"]))]
    blue = np.array([0x25, 0x63, 0xEB]) / 255
    np.testing.assert_allclose(imread(path)[*at][:3], blue, atol=0.1)


def test_a_folder_without_runs_is_refused(tmp_path):
    with pytest.raises(InputError, match="has no run with a result in it"):
        write_figures(tmp_path)


def test_a_damaged_board_is_named(tmp_path):
    make_run(tmp_path)
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(InputError, match=r"sweep\.json is damaged"):
        read_records(tmp_path)


def test_a_damaged_run_is_named(tmp_path):
    (make_run(tmp_path) / "result.json").write_text("{}")
    with pytest.raises(InputError, match=r"ball_in_cup-autotune-0- is damaged"):
        write_figures(tmp_path)
