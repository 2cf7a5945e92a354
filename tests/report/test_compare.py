"""`compare`: runs of one world agree as often as is said, and others do not."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from simtune.compare import compare, table
from simtune.compare.compare import FALSE_ALARM_RATE, differences, largest_allowed, p_value
from simtune.compare.estimates import Estimates, read_estimates
from simtune.config import CompareConfig
from simtune.errors import InputError
from simtune.experiment import outcome
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.run.files import read_json, write_json
from simtune.run_data import read_finished
from simtune.tasks import load_task
from simtune.tuning.joint import Joint
from simtune.tuning.range_update import read_curves
from simtune.tuning.survival_curves import candidate_grid, with_fit

SPACE = load_task("finger").parameters
STD = 0.02  # of the first range
AXES = {p.name: {"scale": p.scale, "low": p.low, "high": p.high} for p in SPACE}


def a_run(path: Path, mean: np.ndarray, space: ParameterSpace = SPACE, **facts) -> Path:
    """The folder of a run that found (N,) `mean`, in coordinates of its first range, to ± STD."""
    first = Distribution.first(space, space.nominal)
    grid = np.repeat(candidate_grid()[None], len(space), 0)
    curves = with_fit(np.clip(1 - grid, 0, 1), mean, np.full(len(space), STD))
    estimate = read_curves(curves, first, first)
    joint = Joint.of(estimate, space)
    facts = {"task": "finger", "method": "autotune", "search": "posterior", "seed": 0} | facts
    result = outcome.result(facts, space, space.nominal, estimate, None)
    draws = joint.draw(100, np.random.default_rng(0))
    path.mkdir()
    write_json(path / "result.json", result | outcome.joint_posterior(joint, estimate, draws))
    write_json(path / "config.json", {"config": {"task": "finger", "task_content": "a"}})
    return path


def compared(*runs: Path) -> dict:
    return compare(CompareConfig(run_folders=runs))


def test_runs_of_one_world_agree_but_for_the_stated_share_of_false_alarms():
    rng, num = np.random.default_rng(0), len(SPACE)
    std, other_std = rng.uniform(0.01, 0.1, (2, num))
    rejected = 0
    for _ in range(4000):
        one, other = std * rng.normal(size=num), other_std * rng.normal(size=num)
        z = differences(np.array([one, other]), np.array([std, other_std]))
        rejected += np.abs(z).max() > largest_allowed(num, FALSE_ALARM_RATE)
    assert rejected / 4000 == pytest.approx(FALSE_ALARM_RATE, abs=0.012)


def test_limit_and_probability_by_hand():
    assert largest_allowed(1, 0.05) == pytest.approx(1.95996, abs=1e-4)
    assert p_value(1.95996, 1) == pytest.approx(0.05, abs=1e-5)
    assert largest_allowed(2, 0.0975) == pytest.approx(1.95996, abs=1e-4)  # 1 − .95²
    assert p_value(-largest_allowed(10, 0.05), 10) == pytest.approx(0.05)
    np.testing.assert_allclose(
        differences(np.array([[1.0], [11.0]]), np.array([[3.0], [4.0]])), [2]
    )
    # 0, 0 and 3 with deviations of 1: μ = 1, χ² = 6 with 2 degrees of freedom: e⁻³.
    (z,) = differences(np.array([[0.0], [0.0], [3.0]]), np.ones((3, 1)))
    assert p_value(z, 1) == pytest.approx(np.exp(-3))


def test_runs_that_agree(tmp_path):
    mean = np.full(len(SPACE), 0.5)
    one = a_run(tmp_path / "one", mean)
    other = a_run(tmp_path / "other", mean + STD * np.linspace(-1, 1, len(SPACE)))
    result = json.loads(json.dumps(compared(one, other)))
    assert result["agree"] is True
    assert result["notes"] == []
    away = [p["difference_std"] for p in result["parameters"].values()]
    # Tails make intervals wider than the fit's alone, so a little less than 1 / √2.
    np.testing.assert_allclose(away, np.linspace(-1, 1, len(SPACE)) / 2**0.5, atol=0.15)
    assert abs(away[-1]) < 1 / 2**0.5
    first = read_json(one / "result.json")["parameters"]["spinner_mass"]
    said = result["parameters"]["spinner_mass"]["estimates"][0]
    assert said == {key: first[key] for key in ("mean", "low", "high", "verdict")}
    lines = table(result)
    assert len(lines) == len(SPACE) + 3
    assert lines[-1].startswith("The runs agree: the largest of")
    assert "in 5 % of pairs of runs" in lines[-1]
    assert compared(other, one)["parameters"]["spinner_mass"]["difference_std"] == -away[0]


def test_many_runs_of_one_world_agree_but_for_the_stated_share(tmp_path):
    rng = np.random.default_rng(1)
    std = rng.uniform(0.01, 0.1, (5, 4))
    rejected = 0
    for _ in range(4000):
        z = differences(std * rng.normal(size=std.shape), std)
        rejected += z.max() > largest_allowed(4, FALSE_ALARM_RATE)
    assert rejected / 4000 == pytest.approx(FALSE_ALARM_RATE, abs=0.012)


def test_three_runs_in_one_table(tmp_path):
    means = np.full((3, len(SPACE)), 0.5)
    means[2, 1] += 8 * STD
    runs = [a_run(tmp_path / str(i), mean) for i, mean in enumerate(means)]
    assert compared(*runs[:2])["agree"] is True
    result = compared(*runs)
    assert (result["agree"], result["largest"]) == (False, SPACE.names[1])
    lines = table(result)
    assert lines[0].count("run ") == 3
    assert len(lines[2].split("[")) == 4  # three intervals
    numbers = re.findall(r"[\d.]+(?=[ ,\]])", lines[2].split("std")[0])[:9]
    assert len({len(its.partition(".")[2]) for its in numbers}) == 1  # of the same decimals
    assert "of sets of runs" in lines[-1]
    with pytest.raises(InputError, match="two runs at least"):
        compared(runs[0])


def test_runs_agree_only_in_what_both_tell(tmp_path):
    mean, runs = np.full(len(SPACE), 0.5), [tmp_path / "one", tmp_path / "other"]
    known = [SPACE.names[1:], SPACE.names[:3]]
    for run, names in zip(runs, known, strict=True):
        a_run(run, mean)
        result = read_json(run / "result.json")
        for name, its in result["parameters"].items():
            its["verdict"] = "weak" if name in names else "not identifiable"
        write_json(run / "result.json", result)
    result = compared(*runs)
    assert result["told"] == list(SPACE.names[1:3])
    num = len(SPACE)
    said = table(result)[-1]
    assert said.startswith(f"In 2 of {num} parameters, which both tell, the runs agree: ")
    for its in (other := read_json(runs[1] / "result.json"))["parameters"].values():
        its["verdict"] = "not identifiable"
    write_json(runs[1] / "result.json", other)
    assert table(compared(*runs))[-1].startswith("No parameter is told by both runs, and so ")
    assert compared(*runs)["told"] == []


def test_runs_that_disagree_in_one_parameter(tmp_path):
    mean = np.full(len(SPACE), 0.5)
    away = mean + 8 * STD * (np.arange(len(SPACE)) == 1)
    result = compared(a_run(tmp_path / "one", mean), a_run(tmp_path / "other", away))
    assert result["agree"] is False
    assert result["largest"] == SPACE.names[1]
    assert result["p_value"] < 1e-3
    assert "The runs disagree" in table(result)[-1]
    assert SPACE.names[1] in table(result)[-1]


def test_notes_say_where_agreeing_says_little(tmp_path):
    mean, recordings = np.full(len(SPACE), 0.5), {"dataset_hash": "abc"}
    one = a_run(tmp_path / "one", mean, recordings=recordings)
    other = a_run(tmp_path / "other", mean, recordings=recordings)
    assert "of the same recordings" in compared(one, other)["notes"][0]
    assert compared(one, one)["notes"] == ["runs 1 and 2 are one and the same"]
    named = [{"names": names} | recordings for names in (["a", "b"], ["b", "c"], ["d"])]
    some, overlap, apart = (
        a_run(tmp_path / its["names"][-1], mean, recordings=its) for its in named
    )
    assert "of the same recordings" in compared(some, overlap)["notes"][0]
    assert compared(some, apart)["notes"] == []
    write_json(other / "config.json", {"config": {"task": "finger", "task_content": "b"}})
    assert "the tuning file is not the same" in compared(one, other)["notes"][1]
    assert "note: runs 1 and 2 are of" in "\n".join(table(compared(one, other)))


def test_notes_tell_the_same_films_of_a_pseudo_real_world_and_two_worlds(tmp_path):
    one, other = (a_run(tmp_path / name, np.full(len(SPACE), 0.5)) for name in "ab")

    def notes(**changes) -> list[str]:
        config = {"task": "finger", "real": "pseudo", "seed": 1, "real_gap": False, "truth": "t"}
        write_json(one / "config.json", {"config": config})
        write_json(other / "config.json", {"config": config | changes})
        return compared(one, other)["notes"]

    (said,) = notes()
    assert said.startswith("runs 1 and 2 are of the same recordings")
    assert notes(seed=2) == notes(real_gap=True) == []
    assert notes(truth="u") == [
        "runs 1 and 2 are of pseudo-real worlds with different true parameters"
    ]
    assert notes(real="monday", truth=None) == []  # which may be of the same world


def test_what_a_trimmed_tuning_file_tunes_too_is_compared_with_a_note(tmp_path):
    mean = np.full(len(SPACE), 0.5)
    one = a_run(tmp_path / "one", mean)
    fewer = ParameterSpace(SPACE.parameters[1:])
    other = a_run(tmp_path / "fewer", mean[1:], fewer, task="finger2")
    for run in (one, other):
        (run / "sources").mkdir()
        (run / "sources" / "arm.xml").write_text("<mujoco/>")
        (run / "sources" / f"{run.name}.toml").write_text(run.name)
    result = compared(one, other)
    assert list(result["parameters"]) == list(fewer.names)
    assert result["agree"] is True
    (note,) = result["notes"]
    assert note == f"not tuned alike in all runs, so not compared: {SPACE.names[0]}"


def test_estimates_within_other_bounds_are_compared_along_one_scale(tmp_path):
    mean, first = np.full(len(SPACE), 0.5), SPACE.parameters[0]
    wider = ParameterSpace((dataclasses.replace(first, high=99), *SPACE.parameters[1:]))
    runs = [a_run(tmp_path / "one", mean), a_run(tmp_path / "wider", mean, wider)]
    found = [Estimates.along(read_estimates(read_finished(run)), AXES) for run in runs]
    values = SPACE.from_unit(np.array([each.mean for each in found]))[:, 0]
    told = [read_json(run / "result.json")["parameters"][first.name]["mean"] for run in runs]
    np.testing.assert_allclose(values, told, rtol=0.02)
    assert compared(*runs)["notes"] == [f"of other bounds in some runs: {first.name}"]


def test_what_cannot_be_compared_is_said_in_a_line(tmp_path):
    mean = np.full(len(SPACE), 0.5)
    one = a_run(tmp_path / "one", mean)

    def refused(other: Path) -> str:
        with pytest.raises(InputError) as error:
            compared(one, other)
        assert "\n" not in str(error.value)
        return str(error.value)

    assert "there is no such folder" in refused(tmp_path / "none")
    cartpole = load_task("cartpole").parameters
    elsewhere = a_run(tmp_path / "a", np.full(len(cartpole), 0.5), cartpole, task="cartpole")
    assert "is of finger" in refused(elsewhere)
    assert "of cartpole: compare runs of one task" in refused(elsewhere)
    renamed = [dataclasses.replace(p, name=f"my_{p.name}") for p in SPACE.parameters]
    none_shared = a_run(tmp_path / "b", mean, ParameterSpace(renamed))
    assert "no parameter is tuned in all of" in refused(none_shared)
    assert "gives no intervals" in refused(a_run(tmp_path / "d", mean, search="paper"))
    assert "--method dr" in refused(a_run(tmp_path / "e", mean, search=None, method="dr"))
    older = a_run(tmp_path / "f", mean)
    result = read_json(older / "result.json")
    write_json(older / "result.json", {k: v for k, v in result.items() if k != "covariance"})
    assert "earlier version" in refused(older)
    for damage in ({"mean": mean}, {"matrix": [[1]]}, {"matrix": None}, {"mean": "?"}):
        spoilt = result["covariance"] | damage
        if "matrix" not in damage:
            del spoilt["matrix"]
        write_json(older / "result.json", result | {"covariance": spoilt})
        assert "is damaged" in refused(older)
    (older / "result.json").unlink()
    assert "no result yet" in refused(older)
