"""benchmarks/accuracy.py without its runs: truths, and the figures made of results."""

import json
from pathlib import Path

import numpy as np
import pytest

from simtune.real.truth import Truth
from simtune.tasks import TASKS, load_task

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(autouse=True)
def _as_a_script_finds_them(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))


@pytest.mark.parametrize("task", TASKS)
def test_truths_are_reproducible_and_within_bounds(task):
    from baselines.one_run import true_parameters

    space = load_task(task).parameters
    drawn = [true_parameters(task, space, world) for world in range(40)]
    assert drawn[3] == true_parameters(task, space, 3)
    values = np.array([space.from_dict(truth) for truth in drawn])  # raises out of bounds
    assert len(np.unique(values, axis=0)) == 40
    colours, dynamics = values[:, space.is_colour], values[:, ~space.is_colour]
    assert 0.25 <= colours.min() < 0.35
    assert 0.9 < colours.max() <= 1
    ratios = dynamics / space.nominal[~space.is_colour]
    assert 0.5 <= ratios.min() < 0.65
    assert 1.6 < ratios.max() <= 2


def test_another_task_has_other_truths():
    from baselines.one_run import true_parameters

    walker, cheetah = (load_task(name).parameters for name in ("walker", "cheetah"))
    assert walker.names == cheetah.names
    assert true_parameters("walker", walker, 0) != true_parameters("cheetah", cheetah, 0)


def test_a_far_start_is_four_times_or_a_quarter_of_the_truth():
    space = load_task("cartpole").parameters
    truth = Truth(space, space.nominal)
    starts = truth.wrong_start(0, factor=4.0)
    ratios, are_twice = starts / space.nominal, truth.wrong_start(0) > space.nominal
    np.testing.assert_allclose(ratios % 3.75, 0.25)  # 4 or .25
    assert (starts <= space.high).all()
    has_room = 4 * space.nominal <= space.high
    np.testing.assert_array_equal(
        ratios[has_room] > 1, are_twice[has_room], "the same choice for any factor"
    )


def result(errors: dict[str, float], held: int, steps: int) -> dict:
    """A result.json whose first `held` intervals hold the truth, which is 1."""
    parameters = {
        name: {"mean": 1 + e / 100, "low": 0.9 if i < held else 1.1, "high": 2.0, "real": 1.0}
        | {"percent_error": e}
        for i, (name, e) in enumerate(errors.items())
    }
    return {"parameters": parameters, "sim_steps": steps, "wall_s": 60.0, "real_episodes": 5}


def cartpole_results() -> list[dict]:
    names = load_task("cartpole").parameters.names
    columns = [(8.0, 2, 100), (16.0, 8, 300), (40.0, 5, 200)]  # pole_mass error, held, steps
    return [
        result(dict.fromkeys(names, 0.0) | {"pole_mass": e, "actuator_gain": 8.0}, held, steps)
        for e, held, steps in columns
    ]


def test_scores_are_medians_over_worlds():
    from baselines.scores import mean_errors, score

    space, results = load_task("cartpole").parameters, cartpole_results()
    assert len(space) == 8
    np.testing.assert_allclose(mean_errors(results), [2.0, 3.0, 6.0])
    scored = score("posterior", results, space)
    assert scored["worlds"] == 3
    assert scored["percent_error"] == pytest.approx(3.0)
    assert scored["percent_error_p90"] == pytest.approx(3 + 0.8 * 3)
    assert scored["dynamics_percent_error"] == {"pole_mass": 16.0, "actuator_gain": 8.0}
    assert scored["coverage"] == pytest.approx((2 + 8 + 5) / 24)
    assert (scored["sim_steps"], scored["wall_s"], scored["real_episodes"]) == (200, 60.0, 5)
    assert score("paper", results, space)["coverage"] is None, "its range is no interval"


def test_the_accuracy_table_and_picture_leave_out_missing_results(tmp_path):
    from baselines.picture import draw
    from baselines.scores import read_results, score_all, table

    for method in ("posterior", "cmaes"):
        for world, content in enumerate(cartpole_results()):
            folder = tmp_path / f"cartpole-{world}-{method}"
            folder.mkdir()
            if method == "cmaes":
                for entry in content["parameters"].values():
                    entry["low"] = entry["high"] = None
            (folder / "result.json").write_text(json.dumps(content))
    (tmp_path / "walker-0-paper").mkdir()  # not finished
    results = read_results(tmp_path)
    assert {key: len(worlds) for key, worlds in results.items()} == {
        ("cartpole", "posterior"): 3,
        ("cartpole", "cmaes"): 3,
    }
    lines = table(score_all(results)).splitlines()
    assert len(lines) == 4
    assert lines[2].startswith("| cartpole | posterior | 3 | 3.0 % | 5.4 % | pole_mass 16.0 %, ")
    assert "| 62 % |" in lines[2]
    assert "| – |" in lines[3]
    draw(results, tmp_path / "accuracy.png", "title")
    assert (tmp_path / "accuracy.png").read_bytes().startswith(b"\x89PNG")


def test_honesty_cases_differ_from_the_filmed_world_as_they_are_called():
    import honesty

    worlds = {case.__name__: case(load_task(name)) for case, name in honesty.CASES.items()}
    filmed, tuned = (world.load_model() for world in worlds["wrong"])
    pole = filmed.body("pole_1").id
    assert filmed.geom_size[-1, 1] == pytest.approx(1.2 * tuned.geom_size[-1, 1])
    assert filmed.body_mass[pole] == tuned.body_mass[pole], "longer, but no heavier"
    still = worlds["unseeable"][0].load_model()
    assert still.body("stone").jntnum[0] == 0
    assert worlds["unseeable"][1].parameters.names[-1] == "stone_mass"
    assert worlds["together"][1].parameters.names[-1] == "cart_mass"
    assert worlds["right"][0] is worlds["right"][1]
    assert worlds["spinner"][1].parameters.names[-1] == "spinner_damping"
    links = worlds["links"][1].parameters
    assert links.names[:3] == ("torso_mass", "thighs_mass", "legs_mass")
    assert "mass" not in links.names
    together = [body for p in list(links)[:3] for body in p.objects]
    (whole,) = (p for p in load_task("walker").parameters if p.name == "mass")
    assert sorted(together) == sorted(whole.objects), "each link once"


def test_error_of_a_correlated_pair_is_that_of_its_ratio_or_product():
    import honesty

    ratios = {"a": 1.2, "b": 1.2, "c": 1 / 1.2}
    assert honesty.percent_error_together("a, b", 0.9, ratios) == 0
    assert honesty.percent_error_together("a, c", -0.9, ratios) == 0
    assert honesty.percent_error_together("a, b", -0.9, ratios) == 44
