"""`import simtune`: its public names, and what they give."""

import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from unittest.mock import Mock

import numpy as np
import pytest

import simtune
from simtune.api.policy import Policy
from simtune.cameras.footage import Footage
from simtune.config import EvaluateConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.outcome import asked
from simtune.parameters.values_file import read_parameters
from simtune.run.files import write_json
from simtune.tasks import cartpole
from simtune.tuning_run import tune as tune_from_options

NAMES = ["Result", "check", "load", "load_task", "record", "train", "tune"]


@pytest.fixture(scope="module")
def result(quickly, tmp_path_factory) -> simtune.Result:
    """What a search that takes seconds made of a pseudo-real cartpole."""
    out = tmp_path_factory.mktemp("api") / "run"
    with quickly() as settings, pytest.MonkeyPatch.context() as patch:
        settings = replace(settings, search=replace(settings.search, num_rounds=1))
        quick = partial(tune_from_options, settings=settings)
        patch.setattr("simtune.tuning_run.tune", quick)
        return simtune.tune("cartpole", out=str(out), real_episodes=2, image_size=32, seed=3)


def test_nothing_but_the_public_names_is_exported():
    assert simtune.__all__ == NAMES
    assert dir(simtune) == sorted([*NAMES, "__version__"])
    assert all(callable(getattr(simtune, name)) for name in NAMES)
    with pytest.raises(AttributeError, match="no attribute 'tnue'"):
        _ = simtune.tnue


def test_import_loads_nothing_heavy():
    code = """if True:
    import sys
    import simtune
    assert not {"torch", "mujoco", "numpy"} & set(sys.modules), sys.modules
    import os
    before = dict(os.environ)
    simtune.load
    assert os.environ == before
    assert "torch" not in sys.modules
    """
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_no_module_hides_a_public_name():
    for module in ("cli", "api", "algorithm", "filming", "evaluation.evaluate"):
        import_module(f"simtune.{module}")
    assert not any(isinstance(getattr(simtune, name), ModuleType) for name in simtune.__all__)


@pytest.mark.thorough
def test_a_result_tells_what_result_json_does(result):
    found = result.parameters["pole_mass"]
    written = result.content["parameters"]["pole_mass"]
    assert (found.mean, found.low, found.high) == tuple(written[k] for k in ("mean", "low", "high"))
    assert (found.name, found.unit, found.nominal) == ("pole_mass", "kg", 0.1)
    with pytest.raises(KeyError, match=r"no parameter 'pole_mas' .*; did you mean 'pole_mass'"):
        _ = result.parameters["pole_mas"]
    assert result.parameters.get("pole_mas") is None
    assert found.real == 0.1
    assert found.verdict in ("identified", "weak", "not identifiable")
    assert result.task == "cartpole"
    assert result.warnings == result.content["warnings"]
    assert simtune.load(str(result.path)).parameters == result.parameters
    size = len(result.parameters)
    assert result.covariance.shape == (size, size)


@pytest.mark.thorough
def test_a_result_shows_itself_as_a_table(result):
    lines = repr(result).splitlines()
    assert lines[0] == f"simtune.Result of cartpole, {result.path}"
    assert lines[1].split()[:4] == ["parameter", "unit", "start", "estimate"]
    assert [line.split()[0] for line in lines[2 : 2 + len(result.parameters)]] == list(
        result.parameters
    )
    html = result._repr_html_()
    assert html.count("<tr>") == 1 + len(result.parameters)
    assert "pole_mass" in html


@pytest.mark.thorough
def test_parameters_of_a_result_show_themselves_as_its_table(result):
    assert repr(result).startswith(f"simtune.Result of cartpole, {result.path}\n")
    assert repr(result.parameters) in repr(result)
    assert result.parameters._repr_html_() in result._repr_html_()


@pytest.mark.thorough
def test_results_are_compared(result):
    found = result.compare(result, str(result.path))
    assert found["agree"]
    assert repr(found).startswith("cartpole: run 1 ")
    with pytest.raises(ValueError, match="two runs at least can be compared"):
        result.compare()
    with pytest.raises(ValueError, match="there is no such folder"):
        result.compare(result.path / "none")


@pytest.mark.thorough
def test_a_finished_run_is_returned_as_it_is(result, caplog):
    again = {"real_episodes": 2, "image_size": 32, "seed": 3}
    with pytest.MonkeyPatch.context() as patch, caplog.at_level("INFO", "simtune"):
        patch.setattr("simtune.tuning_run.tune", lambda *_, **__: pytest.fail("tuned"))
        found = simtune.tune("cartpole", out=result.path, budget_minutes=1e-4, **again)
        assert found.content == result.content
        assert f"{result.path} is finished: " in caplog.text
        with pytest.raises(ValueError, match="holds a run with seed 3, now 4"):
            simtune.tune("cartpole", out=result.path, budget_minutes=1e-4, **again | {"seed": 4})


def test_what_a_policy_reached_is_a_results_score(tmp_path):
    facts = {"unit": "kg", "nominal": 0.1, "initial": 0.2, "mean": 0.2, "low": 0.1, "high": 0.3}
    content = {"task": "cartpole", "method": "dr", "parameters": {"pole_mass": facts}}
    scored = {"mean": 3.5, "std": 0.5, "episodes": 10}
    write_json(tmp_path / "config.json", {"config": {"task": "cartpole"}})

    def score(**more) -> dict:
        write_json(tmp_path / "result.json", content | more)
        return simtune.load(tmp_path).score

    assert score(**{"return": scored}) == scored
    reached = {"mean": 0.5, "std": 0.5, "episodes": 10}
    assert score(**{"return": scored, "success": reached}) == scored | {"success": reached}
    with pytest.raises(ValueError, match="has no score: it has no policy"):
        score()
    with pytest.raises(ValueError, match=r"no score: its world cannot be played: evaluate\(param"):
        score(policy_steps=50)


def test_a_run_is_evaluated_as_the_command_does(tmp_path, monkeypatch):
    write_json(tmp_path / "config.json", {"config": {"task": "cartpole"}})
    facts = {"unit": "kg", "nominal": 0.1, "initial": 0.2, "mean": 0.25, "low": 0.1, "high": 0.3}
    content = {"task": "cartpole", "parameters": {"pole_mass": facts}}
    write_json(tmp_path / "result.json", content)
    run, asked_for = simtune.load(tmp_path), []

    def evaluate(config: EvaluateConfig) -> dict:
        space = simtune.load_task("cartpole").parameters
        asked_for.append((config, read_parameters(config.parameters, space)[0]))
        return {"mean": 1.0}

    with pytest.raises(ValueError, match=r"is of `simtune tune` and has no policy.*give real REC"):
        run.evaluate()
    monkeypatch.setattr("simtune.evaluation.evaluate.evaluate", evaluate)
    assert run.evaluate(parameters={"pole_mass": np.float64(0.3)}, episodes=4) == {"mean": 1.0}
    run.evaluate(parameters=run.parameters)
    run.evaluate(parameters=tmp_path / "result.json")
    assert [mass for _, mass in asked_for] == [0.3, 0.25, 0.25]
    assert [(config.run_folder, config.episodes) for config, _ in asked_for] == [
        (tmp_path, 4),
        (tmp_path, None),
        (tmp_path, None),
    ]
    with pytest.raises(ValueError, match=r"^parameters: no parameter 'pole_mas'"):
        run.evaluate(parameters={"pole_mas": 0.3})
    with pytest.raises(ValueError, match=r"^episodes must be at least 1, got 0"):
        run.evaluate(episodes=0)


@pytest.mark.thorough
def test_a_world_is_recorded_and_read_back(tmp_path, one_renderer_each):
    task = simtune.load_task("cartpole")
    short = {"episodes": 1, "image_size": 16}
    folder = simtune.record(task, parameters={"pole_mass": 0.3}, out=tmp_path / "films", **short)
    assert folder == tmp_path / "films"
    assert simtune.check(task, real=folder)["recordings"]["episodes"] == 1
    with pytest.raises(ValueError, match=r"^parameters: parameter 'pole_mass' must lie in"):
        simtune.record(task, parameters={"pole_mass": 9}, out=tmp_path / "x", **short)
    with pytest.raises(ValueError, match=r"no option 'size' in simtune.record"):
        simtune.record(task, out=tmp_path / "x", size=3)
    assert not (tmp_path / "x").exists()


def test_tasks_and_parameters_show_themselves_in_few_words():
    task = simtune.load_task("cartpole")
    said = "<Task cartpole: 8 parameters, camera fixed, sensor encoders, 0.08 s a step>"
    assert repr(task) == said
    head, first, *rest = repr(task.parameters).splitlines()
    assert head.split() == ["parameter", "unit", "nominal", "low", "high", "scale"]
    assert first.split() == ["pole_mass", "kg", "0.1", "0.01", "1", "log"]
    assert len(rest) == 7
    ball = simtune.load_task(Path(__file__).parents[2] / "examples" / "bouncing_ball" / "tune.toml")
    assert repr(ball) == "<Task bouncing_ball: 7 parameters, camera render, 0.05 s a step>"


@pytest.mark.thorough
def test_samples_are_the_joint_posteriors_and_begin_alike(result):
    few, many = result.samples(3), result.samples(4003)
    assert list(few) == list(result.parameters)
    for name, values in few.items():
        assert values.shape == (3,)
        np.testing.assert_allclose(many[name][:3], values)
    few["pole_mass"][:] = 0  # the caller's own
    assert result.samples(3)["pole_mass"].all()
    with pytest.raises(ValueError, match="num must be a whole number of at least 1, got 0"):
        result.samples(0)


@pytest.mark.thorough
def test_the_model_has_the_estimates(result, tmp_path):
    model = result.model()
    mass = float(model.body("pole_1").mass[0])
    assert mass == pytest.approx(result.parameters["pole_mass"].mean)
    out = result.export(tmp_path / "tuned", samples=5)
    assert {"model.xml", "samples.csv"} <= {path.name for path in Path(out).iterdir()}


@pytest.mark.thorough
def test_a_plot_has_a_row_a_parameter(result, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    assert result.plot(ax=ax) is ax
    assert [label.get_text() for label in ax.get_yticklabels()] == list(result.parameters)
    only = result.plot(np.array(["pole_mass"]), ax=Figure().subplots())
    assert len(only.get_yticks()) == 1
    assert len(result.plot("pole_mass", ax=Figure().subplots()).get_yticks()) == 1
    with pytest.raises(ValueError, match="names is empty"):
        result.plot([])
    with pytest.raises(ValueError, match=r"no parameter 'pole_mas'.*mean 'pole_mass'"):
        result.plot(["pole_mas"])


@pytest.mark.thorough
def test_curves_and_pairs_are_drawn_as_figures(result, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = ["pole_mass", "actuator_gain", "body_r"]
    values, prob_higher = result.curves["pole_mass"]
    curves = [ax for ax in result.plot_curves(names).axes if ax.get_visible()]
    assert [ax.get_title() for ax in curves] == names
    np.testing.assert_array_equal(curves[0].lines[0].get_xydata().T, [values, prob_higher])
    assert curves[0].lines[1].get_xdata()[0] == result.parameters["pole_mass"].real
    draws, axes = result.samples(500), result.plot_pairs(names).axes
    assert [ax.get_visible() for ax in axes] == np.tri(3, dtype=bool).ravel().tolist()
    drawn = axes[3].lines[0].get_xydata().T
    np.testing.assert_array_equal(drawn, [draws["pole_mass"], draws["actuator_gain"]])
    for plot in (result.plot_curves, result.plot_pairs):
        with pytest.raises(ValueError, match="no parameter 'pole_mas'"):
            plot(["pole_mas"])
    monkeypatch.setattr(type(result), "curves", {})
    with pytest.raises(InputError, match="tells no curve of pole_mass"):
        result.plot_curves()


@pytest.mark.thorough
def test_pandas_gets_a_row_a_parameter_or_is_named_as_missing(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        result.to_pandas()
    monkeypatch.undo()
    pytest.importorskip("pandas")
    frame = result.to_pandas()
    assert list(frame.index) == list(result.parameters)
    assert frame.loc["pole_mass", "mean"] == result.parameters["pole_mass"].mean


@pytest.mark.thorough
def test_check_takes_a_loaded_task_and_shows_a_table(one_renderer_each):
    task = simtune.load_task("cartpole")
    found = simtune.check(task, episodes=1)
    assert list(found["parameters"]) == list(task.parameters.names)
    assert "told to" in repr(found)


def test_options_are_checked_and_named_as_python_spells_them(tmp_path):
    with pytest.raises(ValueError, match=r"^budget_minutes must be above 0, got 0$"):
        simtune.tune("cartpole", out=tmp_path / "run", budget_minutes=0)
    with pytest.raises(
        ValueError, match=r"no option 'serch' in simtune.tune; did you mean 'search"
    ):
        simtune.tune("cartpole", out=tmp_path / "run", serch="paper")
    with pytest.raises(ValueError, match=r"no task 'cartpol'.*did you mean 'cartpole'"):
        simtune.train("cartpol", out=tmp_path / "run")
    with pytest.raises(ValueError, match="is no run: there is no such folder"):
        simtune.load(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"search": "bayes"}, "search must be posterior, paper or regression, got 'bayes'"),
        ({"precision": 0.01}, "precision must be text such as '1%', got 0.01"),
        ({"budget_minutes": "3"}, "budget_minutes must be a number, got '3'"),
        ({"seed": 1.5}, "seed must be a whole number, got 1.5"),
        ({"real_gap": 1}, "real_gap must be true or false, got 1"),
        ({"robot": 3}, "robot must be a path, got 3"),
        ({"real": ""}, "real must be text such as 'pseudo', got ''"),
        ({"robot": ""}, "robot must be a path, got ''"),
    ],
)
def test_options_of_another_type_are_refused(tmp_path, options, said):
    with pytest.raises(ValueError, match=f"^{said}$"):
        simtune.tune("cartpole", out=tmp_path / "run", **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("call", [simtune.load_task, simtune.check])
def test_what_can_be_no_task_is_refused(call):
    with pytest.raises(ValueError, match="the task is a int; expected a built-in task's name"):
        call(3)


def test_numbers_of_numpy_are_numbers(tmp_path):
    check = partial(simtune.check, "cartpole", episodes=np.int64(1), control_hz=np.float32(20))
    with pytest.raises(ValueError, match="control_hz goes with"):  # their types are no reason
        check()


@pytest.mark.parametrize("source", ["", "cartpole"])
def test_a_task_that_no_file_declares_is_refused(tmp_path, source):
    changed = replace(cartpole.balance(), source=source, declared="of mine")
    with pytest.raises(ValueError, match=r"is not as .* declares it: change the tuning file"):
        simtune.tune(changed, out=tmp_path / "run")


def test_the_page_lists_the_public_names_and_no_others():
    page = (Path(__file__).parents[2] / "docs" / "python.md").read_text()
    functions, of_result = page.split("## Result")
    assert sorted(set(re.findall(r"^\| `simtune\.(\w+)", functions, re.M))) == sorted(NAMES)
    listed = {
        name
        for cell in re.findall(r"^\| (`.*?`) \|", of_result, re.M)
        for name in re.findall(r"`(\w+)", cell)
    }
    assert listed == {name for name in vars(simtune.Result) if not name.startswith("_")}
    blocks = re.findall(r"```python\n(.*?)```", page, re.S)
    assert blocks
    for code in blocks:
        compile(code, "python.md", "exec")


def test_nothing_private_is_imported_in_any_example_or_page():
    root = Path(__file__).parents[2]
    files = [root / "README.md", *(root / "docs").rglob("*.md"), *(root / "docs").glob("*.ipynb")]
    files += [f for end in ("py", "md", "toml") for f in (root / "examples").rglob(f"*.{end}")]
    texts = {file: file.read_text() for file in files if ".venv" not in str(file)}
    assert sum("import simtune" in text for text in texts.values()) >= 3
    private = re.compile(r"(?:from|import) simtune\.|from simtune import _|simtune\._")
    assert [file for file, text in texts.items() if private.search(text)] == []


def test_train_takes_the_options_of_its_command(tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr("simtune.algorithm.train", lambda *a: given.append(a[0]))
    options = {"method": "dr", "range_dr": 0.3, "real_parameters": "truth.json"}
    with pytest.raises(ValueError, match="is no run"):  # since nothing was trained
        simtune.train("cartpole", out=str(tmp_path / "run"), policy_steps=50, **options)
    (config,) = given
    assert (config.task, config.out, config.real) == ("cartpole", tmp_path / "run", "pseudo")
    assert (config.method, config.range_dr, config.policy_steps) == ("dr", 0.3, 50)
    assert config.real_parameters == Path("truth.json")


def test_a_training_without_a_search_films_one_episode(tmp_path, monkeypatch):
    monkeypatch.setattr("simtune.algorithm.train", lambda *_: None)
    filmed = []

    def film(episode: int) -> dict:
        filmed.append(episode)
        return {"frames": np.zeros((4, 16, 16, 3), np.uint8), "actions": np.zeros((3, 1)), "hz": 20}

    for method in ("untuned", "dr"):
        with pytest.raises(ValueError, match="is no run"):  # since nothing was trained
            simtune.train("cartpole", out=tmp_path / method, method=method, real=film)
    assert filmed == [0, 0]


def test_a_robot_films_nothing_for_a_run_that_will_be_refused(tmp_path):
    config = TuneConfig(task="cartpole", out=tmp_path)
    stored = asked(config, simtune.load_task("cartpole"))
    write_json(tmp_path / "config.json", {"config": stored | {"real": "pseudo"}})
    tune = partial(simtune.tune, "cartpole", real=lambda i: pytest.fail("filmed"), out=tmp_path)
    with pytest.raises(ValueError, match="holds a run with seed 0, now 1"):
        tune(seed=1)
    with pytest.raises(ValueError, match="a run that was not filmed by a function"):
        tune()


def test_a_robot_films_nothing_for_a_check_with_a_wrong_option():
    with pytest.raises(ValueError, match="episodes must be a whole number, got '3'"):
        simtune.check("cartpole", real=lambda i: pytest.fail("filmed"), episodes="3")


def test_check_finds_a_camera_pose(tmp_path, monkeypatch):
    camera = {"camera": "top", "frames": 9, "warnings": ["far off"], "parameters": {}}
    camera["is_found"] = False
    monkeypatch.setattr("simtune.camera_pose.find_camera_pose", lambda *a: camera)
    found = simtune.check("cartpole", real=tmp_path, camera_pose=str(tmp_path / "camera.toml"))
    assert found == camera
    told = repr(found).splitlines()
    assert told[:2] == ["camera top, by 9 frames", "warning: far off"]
    assert told[2].startswith("not found: nothing is written to")


def test_a_result_without_a_search_has_no_samples_and_no_verdicts(tmp_path):
    facts = {"unit": "kg", "nominal": 0.1, "initial": 0.2, "mean": 0.2, "low": 0.1, "high": 0.3}
    content = {"task": "cartpole", "method": "dr", "parameters": {"pole_mass": facts}}
    write_json(tmp_path / "config.json", {"config": {"task": "cartpole"}})
    write_json(tmp_path / "result.json", content)
    result = simtune.load(tmp_path)
    assert "worlds trained in" in repr(result)
    assert "verdict" not in repr(result)
    assert result.parameters["pole_mass"].real is None
    for ask in (result.samples, result.plot, lambda: result.covariance):
        with pytest.raises(ValueError, match="nothing was searched for there"):
            ask()


def test_paths_in_messages_are_as_they_are(tmp_path):
    cache = tmp_path / "datasets--lerobot--pusht"
    with pytest.raises(ValueError, match=re.escape(str(cache))):
        simtune.check("cartpole", real=cache)


def test_exports_name_options_as_python_spells_them(result, tmp_path):
    with pytest.raises(ValueError, match=r"^samples must be at least 1, got -1"):
        result.export(tmp_path / "tuned", samples=-1)


def test_a_run_without_a_policy_says_so(result):
    with pytest.raises(ValueError, match=r"is no folder that `simtune train` wrote") as error:
        result.policy()
    assert str(error.value).endswith("wrote")  # no advice on other commands


def test_a_path_may_begin_with_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    asked_for = []
    monkeypatch.setattr("simtune.tuning_run.tune", lambda c, *_, **__: asked_for.append(c))
    with pytest.raises(ValueError, match=f"^{re.escape(str(tmp_path / 'run'))} is no run"):
        simtune.tune("cartpole", out="~/run", real="~/films")
    assert (asked_for[0].out, asked_for[0].real) == (tmp_path / "run", str(tmp_path / "films"))
    with pytest.raises(ValueError, match=re.escape(str(tmp_path / "arm.toml"))):
        simtune.load_task("~/arm.toml")
    assert not (tmp_path / "~").exists()


def test_real_must_be_said(tmp_path):
    with pytest.raises(ValueError, match="out is a int; expected a folder's path"):
        simtune.tune("cartpole", out=3)
    with pytest.raises(ValueError, match="real is None; expected 'pseudo', a path, arrays"):
        simtune.tune("cartpole", real=None, out=tmp_path / "run")


def test_pictures_of_a_policy_keep_their_size_during_an_episode(monkeypatch):
    trained = Mock()
    trained.schedule = Mock(num_stacked=3, image_size=8)
    trained.task.cameras = [Footage(is_square=True)]
    monkeypatch.setattr("simtune.api.policy.load_trained", lambda run: trained)
    monkeypatch.setattr("simtune.api.policy.scale_actions", Mock(return_value=np.zeros((1, 1))))
    policy = Policy(Path())
    small, large = (np.zeros((height, 2 * height, 3), np.uint8) for height in (24, 48))
    policy.act(small)
    with pytest.raises(ValueError, match=r"picture \(24, 48, 3\), .* got \(48, 96, 3\): call"):
        policy.act(large)
    policy.reset()
    policy.act(large)
    policy.act(large)
    with pytest.raises(ValueError, match=r"got \(24, 48, 3\)"):
        policy.act(small)
