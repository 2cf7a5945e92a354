"""Tasks that a dict in Python declares, with a model or an environment as an object."""

import importlib.util
import tomllib
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest

import simtune
from simtune.api import declared
from simtune.errors import InputError
from simtune.experiment import outcome
from simtune.experiment.experiment import build_experiment
from simtune.experiment.run import Run
from simtune.parameters import ParameterSpace
from simtune.parameters.values_file import read_parameters

EXAMPLES = Path(__file__).parents[2] / "examples"
CART = EXAMPLES / "cart_pendulum"
TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
SCENE = """
<mujoco>
  <asset><mesh name="m" file="m.obj"/></asset>
  <worldbody>
    <camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1"/>
    <body name="b"><joint name="j"/><geom name="g" type="mesh" mesh="m" mass="1.5"/></body>
  </worldbody>
</mujoco>
"""


def values_of(file: Path) -> dict:
    return tomllib.loads(file.read_text())


def cart(**changed) -> dict:
    """The example's tuning file with its model as an object."""
    spec = mujoco.MjSpec.from_file(str(CART / "scene.xml"))
    return values_of(CART / "tune.toml") | {"model": spec, "policy": None} | changed


@pytest.fixture(scope="module")
def ball():
    """The class of an environment."""
    spec = importlib.util.spec_from_file_location("env", EXAMPLES / "bouncing_ball" / "env.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.BouncingBall


def bouncing(environment, **changed) -> dict:
    values = values_of(EXAMPLES / "bouncing_ball" / "tune.toml")
    return values | {"environment": environment} | changed


# --- models -------------------------------------------------------------------------------


@pytest.mark.parametrize("is_object", [True, False])
def test_a_dict_declares_what_a_tuning_file_does(is_object, monkeypatch):
    monkeypatch.chdir(CART)
    values = cart() if is_object else values_of(CART / "tune.toml")
    task, same = simtune.load_task(values), simtune.load_task(CART / "tune.toml")
    assert list(task.parameters) == list(same.parameters)
    assert (task.name, task.cameras, task.step_s) == (same.name, same.cameras, same.step_s)
    assert (task.reward is None) == is_object
    model, its = task.load_model(), same.load_model()
    for field in ("body_mass", "geom_pos", "geom_rgba", "dof_damping", "actuator_gear", "qpos0"):
        np.testing.assert_allclose(getattr(model, field), getattr(its, field), rtol=1e-5)


def test_meshes_that_a_spec_holds_are_written_with_it():
    spec = mujoco.MjSpec.from_string(SCENE, assets={"m.obj": TETRAHEDRON})
    mass = {"name": "mass", "kind": "mass", "objects": "b"}
    values = {"model": spec, "control_timestep_s": np.float32(0.05), "parameters": (mass,)}
    task = simtune.load_task(values)
    assert task.parameters.names == ("mass",)
    np.testing.assert_array_equal(task.parameters.nominal, [1.5])
    assert {file.name for file in task.files} == {"task.toml", "model.xml", "m.obj"}
    assert simtune.load_task(values).content_hash == task.content_hash
    assert spec.meshes[0].file == "m.obj"  # the caller's own is as it was


@pytest.mark.parametrize("is_attached", [False, True])
@pytest.mark.parametrize("path", ["m.obj", "parts/m.obj"])
def test_meshes_are_found_by_the_path_that_a_spec_holds_them_by(path, is_attached):
    xml = SCENE.replace("<asset>", '<compiler meshdir="parts"/><asset>')
    spec = mujoco.MjSpec.from_string(xml, assets={path: TETRAHEDRON})
    prefix = "left/" if is_attached else ""
    if is_attached:
        hand, spec = spec, mujoco.MjSpec()
        spec.attach(hand, prefix=prefix, frame=spec.worldbody.add_frame())
    mass = {"name": "mass", "kind": "mass", "objects": f"{prefix}b"}
    values = {"model": spec, "camera": f"{prefix}front", "control_timestep_s": 0.05}
    task = simtune.load_task(values | {"parameters": [mass]})
    assert (task.load_model().mesh_vertnum, task.parameters["mass"].nominal) == (4, 1.5)


@pytest.fixture
def opened(quickly, monkeypatch):
    """Makes `simtune.tune` open a run, and write its first estimate as a result."""

    def tune(config, report, *, task):
        experiment = build_experiment(config, report, settings, task)
        with Run(experiment) as run:
            files = outcome.result({}, experiment.space, experiment.start, run.estimate, None)
            run.folder.write_result({"method": "autotune", "task": task.name} | files)

    with quickly() as settings:
        monkeypatch.setattr("simtune.tuning_run.tune", tune)
        yield


@pytest.mark.thorough
def test_a_run_keeps_the_model_and_goes_on_with_no_other(opened, tmp_path):
    tune = partial(simtune.tune, out=tmp_path / "run", real_episodes=1)
    tune(cart())
    declared._folder.cache_clear()  # and removes it, as Python's end does
    result = simtune.load(tmp_path / "run")
    bob = float(result.model().body("bob").mass[0])
    assert bob == pytest.approx(result.parameters["bob_mass"].mean)
    other = cart()
    other["model"].body("bob").geoms[0].mass = 0.5
    with pytest.raises(
        ValueError, match=r"holds a run with another content of \S+/model.xml \(its"
    ):
        tune(other)


# --- environments -------------------------------------------------------------------------


def test_worlds_of_an_object_are_those_of_its_file(ball):
    file = EXAMPLES / "bouncing_ball" / "tune.toml"
    films = []
    for task in (simtune.load_task(bouncing(ball())), simtune.load_task(file)):
        simulator, rng = task.simulator(image_size=32), np.random.default_rng(1)
        worlds = np.tile(task.parameters.nominal, (2, 1))
        worlds[1] *= 0.8
        films.append(simulator.film(simulator.roll_out(worlds, rng.uniform(-1, 1, (2, 9, 1)), rng)))
    np.testing.assert_array_equal(*films)
    assert films[0].std() > 1


def test_an_environment_is_a_class_a_function_or_an_object(ball):
    tasks = [simtune.load_task(bouncing(given)) for given in (ball, ball(), lambda: ball())]
    for task in tasks:
        assert task.load_actions().names == ("action_0",)
        assert len(task.simulator(image_size=48).points()) == 1
    one, made, by_function = (task.content_hash for task in tasks)
    assert one == made  # by the class's source

    class Heavier(ball):
        pass

    hashes = {simtune.load_task(bouncing(kind)).content_hash for kind in (ball, Heavier)}
    assert len({*hashes, by_function}) == 3
    with pytest.raises(ValueError, match="only `simtune tune` takes those"):
        simtune.check(tasks[0])


@pytest.mark.thorough
def test_a_run_of_an_object_goes_on_with_one_of_the_same_class(ball, opened, tmp_path):
    tune = partial(simtune.tune, out=tmp_path / "run", real_episodes=1)
    values = bouncing(ball, name="ball", episode_steps=24)
    result = tune(simtune.load_task(values))
    assert tune(values | {"environment": ball()}).parameters == result.parameters
    with pytest.raises(ValueError, match="'ball' was an object in Python: no file"):
        result.samples(5000)
    with pytest.raises(ValueError, match="holds a run with another content of the task"):
        tune(values | {"environment": lambda: ball()})


# --- what cannot be -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"model": 3}, r"^task\['model'\]: model must be a text, got 3"),
        ({"modle": 3}, r"^task\['modle'\]: no key 'modle'.*did you mean 'model'"),
        ({"camera": {"name": {3}}}, r"^task\['camera'\]\['name'\]: name must be a text"),
        ({"policy": {"reward": print}}, r"^task\['policy'\]\['reward'\]: reward must be a text"),
        (
            {"parameters": [{"name": "x", "kind": "mas", "objects": "bob"}]},
            r"^task\['parameters'\]\[0\]\['kind'\]: no kind 'mas'.*mean 'mass'",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place_in_the_dict(changed, said):
    with pytest.raises(ValueError, match=said):
        simtune.load_task(cart(**changed))


def test_objects_of_another_kind_are_refused(ball):
    with pytest.raises(ValueError, match=r"^task\['model'\]: a compiled MjModel: give the mujoco"):
        simtune.load_task(cart(model=cart()["model"].compile()))
    with pytest.raises(ValueError, match=r"expected a gymnasium.Env, or a class or function"):
        simtune.load_task(bouncing(3))
    task = simtune.load_task(bouncing(dict))
    with pytest.raises(ValueError, match=r"expected a gymnasium\.Env, got one without action_"):
        task.load_actions()


def test_files_are_copied_from_folders_with_a_colon_in_their_names(tmp_path):
    (source := tmp_path / "a:b").mkdir()
    (source / "r.py").write_text("def good(): ...\n")
    (folder := tmp_path / "task").mkdir()
    assert declared._copied(f"{source / 'r.py'}:good", folder) == "0/r.py:good"
    assert declared._copied(str(source / "r.py"), folder) == "1/r.py"
    assert (folder / "0" / "r.py").is_file()


def test_files_are_utf_8_whatever_the_locale(tmp_path, monkeypatch):
    monkeypatch.setattr("io.text_encoding", lambda encoding, *_: encoding or "ascii")
    values = {"name": "Pfütze"}
    file = declared._write(values, tmp_path / "task")
    assert tomllib.loads(file.read_text(encoding="utf-8")) == values
    (world := tmp_path / "world.json").write_text('{"Röhre": 2}', encoding="utf-8")
    with pytest.raises(InputError, match="Röhre"):
        read_parameters(world, ParameterSpace([]))


def test_values_are_written_as_toml_has_them(tmp_path):
    nested = {"c": [{"d e": {"f": []}}], "😀 \x7f": 1}
    values = {"a": 'x"\\\n°\x7f', "b": [1, 2.5e-07, float("inf"), True]} | nested
    file = declared._write(values, tmp_path / "task")
    assert tomllib.loads(file.read_text(encoding="utf-8")) == values
