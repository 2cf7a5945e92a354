"""`export`: what a run found works in plain MuJoCo as it does here."""

import csv
import json
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import MODEL_FIELDS
from scipy.special import ndtr
from scipy.stats import spearmanr

from simtune.config import ExportConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment import outcome
from simtune.export import export, how_sure
from simtune.parameters import ModelWriter
from simtune.parameters.values_file import read_parameters
from simtune.random_streams import Purpose, stream
from simtune.randomization import Distribution
from simtune.run.files import write_json
from simtune.run.sources import keep_sources
from simtune.tasks import TASKS, load_task
from simtune.tuning.joint import Joint
from simtune.tuning.range_update import read_curves
from simtune.tuning.survival_curves import candidate_grid

# Meshes and a texture from files, two of the same name; a delay, a turn, gravity, a factor on two.
CUBE = """
v 0 0 0
v .1 0 0
v 0 .1 0
v 0 0 .1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
SCENE = """
<mujoco>
  <compiler meshdir="parts"/>
  <asset>
    <mesh name="a" file="left/cube.obj"/> <mesh name="b" file="right/cube.obj" scale="2 2 2"/>
  </asset>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <light pos="0 0 3"/>
    <body name="one" pos="0 0 .5"><joint name="slide" type="slide" axis="1 0 0"/>
      <geom name="left" type="mesh" mesh="a"/>
      <body name="two" pos=".1 0 0"><joint name="ball" type="ball" damping=".1"/>
        <geom name="right" type="mesh" mesh="b"/></body></body>
  </worldbody>
  <actuator><position name="push" joint="slide" kp="5" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
TUNING = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [
  {name = "masses", field = "body_mass", objects = ["one", "two"], low = 0.2, high = 5},
  {name = "damping", field = "dof_damping", objects = ["ball"], low = 0.01, high = 1},
  {name = "gain", field = "actuator_gainprm", component = 0, objects = ["push"], low = 1, high = 9},
  {name = "late", field = "actuator_delay", objects = ["push"], low = 0, high = 0.1},
  {name = "gravity", field = "opt.gravity", component = 2, low = -20, high = -1},
  {name = "roll", field = "cam_quat", objects = ["front"], component = 2, low = -0.5, high = 0.5},
]
"""


@pytest.fixture
def scene(tmp_path) -> Path:
    folder = tmp_path / "scene"
    for part in ("left", "right"):
        (folder / "parts" / part).mkdir(parents=True)
        (folder / "parts" / part / "cube.obj").write_text(CUBE)
    (folder / "scene.xml").write_text(SCENE)
    (folder / "scene.toml").write_text(TUNING)
    return folder / "scene.toml"


def a_run(path: Path, task_name: str, **facts) -> tuple[Path, np.ndarray]:
    """The folder of a run that found something, and what."""
    space = load_task(task_name).parameters
    share = np.random.default_rng(0).uniform(0.3, 0.7, len(space))
    mean = space.low + share * (space.high - space.low)
    found = {
        p.name: {"unit": p.unit, "nominal": p.nominal, "mean": value, "verdict": "weak"}
        | {"low": value - 0.1, "high": value + 0.1}
        for p, value in zip(space, mean.tolist(), strict=True)
    }
    path.mkdir()
    result = {"task": task_name, "method": "autotune", "seed": 3, "warnings": ["odd"], **facts}
    write_json(path / "result.json", result | {"parameters": found})
    config = {"task": task_name, "task_content": load_task(task_name).content_hash}
    write_json(path / "config.json", {"config": config, "versions": {"mujoco": "3"}})
    return path, mean


def the_tuned_world(task_name: str, mean: np.ndarray) -> mujoco.MjModel:
    task = load_task(task_name)
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, mean)
    return model


def differences(a: mujoco.MjModel, b: mujoco.MjModel, rtol: float) -> list[str]:
    def values(model, field):
        return np.asarray(
            getattr(model.opt, field[4:]) if field.startswith("opt.") else getattr(model, field)
        )

    return [
        field
        for field in sorted(MODEL_FIELDS)
        if values(a, field).shape != values(b, field).shape
        or not np.allclose(values(a, field), values(b, field), rtol=rtol, atol=2e-6 * (rtol > 0))
    ]


@pytest.mark.parametrize(
    "name",
    [
        *(
            n if n in ("finger", "rope_peg") else pytest.param(n, marks=pytest.mark.slow)
            for n in TASKS
        ),
        "scene",
    ],
)
def test_the_mjcf_simulates_as_the_tuned_world_does(name, scene, tmp_path):
    name = str(scene) if name == "scene" else name
    run, mean = a_run(tmp_path / "run", name)
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    expected = the_tuned_world(name, mean)
    tuned = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert differences(tuned, expected, rtol=1e-5) == []
    # Beside tuned inertials the geoms' own would count for nothing.
    assert not re.search(r'<geom[^>]* (mass|density)="(?!0")', (out / "model.xml").read_text())
    rng = np.random.default_rng(1)
    worlds = [(model, mujoco.MjData(model)) for model in (tuned, expected)]
    for _ in range(60):
        control = rng.uniform(-1, 1, tuned.nu)
        for model, data in worlds:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)
    assert np.abs(worlds[0][1].qpos).max() > 0
    # The peg begins on an edge: where it touches, a rounded digit decides.
    close = 3e-3 if name == "rope_peg" else 1e-4
    np.testing.assert_allclose(worlds[0][1].qpos, worlds[1][1].qpos, atol=close)


@pytest.mark.parametrize("name", ["finger", "scene"])
def test_the_script_writes_the_same_numbers_into_the_nominal_model(name, scene, tmp_path):
    name = str(scene) if name == "scene" else name
    run, mean = a_run(tmp_path / "run", name)
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    nominal = load_task(name).load_model()
    expected = the_tuned_world(name, mean)
    assert differences(nominal, expected, rtol=0) != []
    runpy.run_path(str(out / "apply.py"))["apply"](nominal)
    assert differences(nominal, expected, rtol=0) == []


def test_meshes_of_an_attached_model_are_found_where_it_has_them(scene, tmp_path):
    """A spec does not tell the folders of attached models."""
    folder = scene.parent
    (folder / "scene.xml").write_text(
        """<mujoco><asset><model name="hand" file="hand/hand.xml"/></asset><worldbody>
        <camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
        <frame pos="0 0 .2"><attach model="hand" body="palm" prefix="left_"/></frame>
        </worldbody></mujoco>"""
    )
    (folder / "hand" / "meshes").mkdir(parents=True)
    (folder / "hand" / "meshes" / "palm.obj").write_text(CUBE)
    (folder / "hand" / "hand.xml").write_text(
        """<mujoco><compiler meshdir="meshes"/><asset><mesh name="palm" file="palm.obj"/></asset>
        <worldbody><body name="palm"><joint name="wrist" axis="0 1 0"/>
        <geom type="mesh" mesh="palm" mass="1"/></body></worldbody></mujoco>"""
    )
    scene.write_text(
        """model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
[[parameters]]
        name = "mass"
kind = "mass"
objects = "left_palm"
"""
    )
    run, mean = a_run(tmp_path / "run", str(scene))
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    assert [path.name for path in (out / "assets").iterdir()] == ["palm.obj"]
    model = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert model.body("left_palm").mass == pytest.approx(mean, rel=1e-4)
    (folder / "hand" / "palm.obj").write_text(CUBE)
    with pytest.raises(InputError, match=r"several files palm\.obj"):
        export(ExportConfig(run_folder=run, out=tmp_path / "again"))


def test_the_six_pictures_of_a_cube_come_along(scene, tmp_path):
    from matplotlib.image import imsave

    sides = ("right", "left", "up", "down", "front", "back")
    named = " ".join(f'file{side}="sky/{side}.png"' for side in sides)
    (scene.parent / "sky").mkdir()
    for i, side in enumerate(sides):
        imsave(scene.parent / "sky" / f"{side}.png", np.full((2, 2, 3), 40 * i, np.uint8))
    sky = f'<asset><texture name="sky" type="skybox" {named}/>'
    (scene.parent / "scene.xml").write_text(SCENE.replace("<asset>", sky))
    run, _ = a_run(tmp_path / "run", str(scene))
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    expected = load_task(str(scene)).load_model().tex_data
    shutil.rmtree(scene.parent / "sky")
    tuned = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    np.testing.assert_array_equal(tuned.tex_data, expected)


def test_the_script_makes_a_tuned_copy_of_a_file(scene, tmp_path):
    run, mean = a_run(tmp_path / "run", str(scene))
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    tuned = scene.parent / "tuned.xml"  # beside the original, where its meshes are
    subprocess.run(
        [sys.executable, out / "apply.py", scene.parent / "scene.xml", tuned], check=True
    )
    model = mujoco.MjModel.from_xml_path(str(tuned))
    masses = mujoco.MjModel.from_xml_path(str(scene.parent / "scene.xml")).body_mass * mean[0]
    np.testing.assert_allclose(model.body_mass, masses, rtol=1e-5)
    expected = the_tuned_world(str(scene), mean)
    np.testing.assert_allclose(model.actuator_delay, expected.actuator_delay, rtol=1e-5)
    np.testing.assert_array_equal(model.actuator_history, expected.actuator_history)


def test_the_script_leaves_no_file_that_cannot_find_its_meshes(scene, tmp_path):
    run, _ = a_run(tmp_path / "run", str(scene))
    script = export(ExportConfig(run_folder=run, out=tmp_path / "out")) / "apply.py"
    files = [scene.parent / "scene.xml", tmp_path / "tuned.xml"]
    called = subprocess.run([sys.executable, script, *files], capture_output=True, text=True)
    assert called.returncode == 1
    said = r"\S+tuned.xml would not load: .*parts/left/cube.obj.*; write it beside \S+scene.xml.*\n"
    assert re.fullmatch(said, called.stderr)
    assert not list(tmp_path.glob("*tuned.xml"))


def test_the_script_overwrites_and_deletes_no_file(scene, tmp_path):
    run, _ = a_run(tmp_path / "run", str(scene))
    script = export(ExportConfig(run_folder=run, out=tmp_path / "out")) / "apply.py"
    model, mine = scene.parent / "scene.xml", tmp_path / "mine.xml"
    mine.write_text("mine")
    for file in (mine, model):
        before = file.read_bytes()
        called = subprocess.run([sys.executable, script, model, file], capture_output=True)
        said = f"{file} is there already, and nothing is overwritten: give another name\n"
        assert (called.returncode, called.stderr.decode()) == (1, said)
        assert file.read_bytes() == before


def test_the_script_says_what_it_lacks(scene, tmp_path):
    run, _ = a_run(tmp_path / "run", str(scene))
    script = export(ExportConfig(run_folder=run, out=tmp_path / "out")) / "apply.py"
    other = tmp_path / "other.xml"
    other.write_text("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>")
    for files, said in (
        ([other, tmp_path / "tuned.xml"], "other.xml is another model than the tuned one: "),
        ([], "expected two files: python apply.py MODEL.xml TUNED.xml"),
        ([tmp_path / "no.xml", tmp_path / "tuned.xml"], "no.xml would not load: "),
        ([scene.parent / "scene.xml", tmp_path / "no" / "t.xml"], "cannot write "),
    ):
        called = subprocess.run([sys.executable, script, *files], capture_output=True, text=True)
        assert called.returncode == 1
        assert said in called.stderr
        assert "Traceback" not in called.stderr


def test_a_run_finds_its_tuning_file_from_any_folder(scene, tmp_path, monkeypatch):
    run, _ = a_run(tmp_path / "run", str(scene))
    monkeypatch.chdir(scene.parent)
    config = TuneConfig(task="scene.toml", out=Path("run"))
    asked = outcome.asked(config, load_task("scene.toml"))
    write_json(run / "config.json", {"config": asked})
    monkeypatch.chdir(tmp_path)
    assert (export(ExportConfig(run_folder=run, out=tmp_path / "out")) / "model.xml").is_file()
    scene.unlink()
    with pytest.raises(InputError, match=r"was made with .*scene.toml, which is not there: bring"):
        export(ExportConfig(run_folder=run, out=tmp_path / "again"))


@pytest.mark.parametrize("change", ["edited", "moved"])
def test_a_run_needs_no_file_but_its_own(scene, change, tmp_path):
    """Nor the model, its meshes, and what it includes."""
    model = scene.parent / "scene.xml"
    eye = '<camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>'
    (scene.parent / "eye.xml").write_text(f"<mujoco><worldbody>{eye}</worldbody></mujoco>")
    model.write_text(
        SCENE.replace(eye, "").replace("<worldbody>", '<include file="eye.xml"/><worldbody>', 1)
    )
    run, _ = a_run(tmp_path / "run", str(scene))
    stored, task = json.loads((run / "config.json").read_text()), load_task(str(scene))
    write_json(run / "config.json", stored | {"sources": keep_sources(run, task.files)})
    before = export(ExportConfig(run_folder=run, out=tmp_path / "before"))
    if change == "edited":
        scene.write_text(TUNING.replace('"damping"', '"friction"'))
        model.write_text(SCENE.replace(".1", ".2"))
    else:
        scene.parent.rename(tmp_path / "elsewhere")
    shutil.move(run, tmp_path / "kept")
    after = export(ExportConfig(run_folder=tmp_path / "kept", out=tmp_path / "after"))
    assert (after / "model.xml").read_bytes() == (before / "model.xml").read_bytes()
    for name in ("cube.obj", "1_cube.obj"):
        assert (after / "assets" / name).read_text() == CUBE


def test_a_model_named_by_an_absolute_path_is_read_there_and_said_when_it_has_changed(
    scene, tmp_path
):
    model = scene.parent / "scene.xml"
    scene.write_text(TUNING.replace('"scene.xml"', f'"{model}"'))
    run, _ = a_run(tmp_path / "run", str(scene))
    stored, task = json.loads((run / "config.json").read_text()), load_task(str(scene))
    write_json(run / "config.json", stored | {"sources": keep_sources(run, task.files)})
    export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    model.write_text(SCENE.replace(".1", ".2"))
    with pytest.raises(InputError, match=f"^{model} is not what {run} was made with: bring it"):
        export(ExportConfig(run_folder=run, out=tmp_path / "again"))


@pytest.mark.parametrize("change", ["built in", "kept", "gone"])
def test_a_task_that_other_versions_read_otherwise_names_them(scene, change, tmp_path):
    source = "cartpole" if change == "built in" else str(scene)
    run, _ = a_run(tmp_path / "run", source)
    stored = json.loads((run / "config.json").read_text())
    stored["sources"] = keep_sources(run, load_task(source).files)
    stored["config"]["task_content"] = "4f"
    write_json(run / "config.json", stored)
    if change == "gone":
        scene.unlink()
    with pytest.raises(InputError, match=rf"^{source} is read .* \(mujoco 3 → \S+\): go back to"):
        export(ExportConfig(run_folder=run, out=tmp_path / "out"))


def test_the_physics_steps_are_those_of_the_run(tmp_path):
    run, _ = a_run(tmp_path / "run", "cartpole", step_s=0.025)  # of a camera at 40 frames/s
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    timestep = mujoco.MjModel.from_xml_path(str(out / "model.xml")).opt.timestep
    nominal = load_task("cartpole").load_model().opt.timestep
    assert timestep != nominal
    assert timestep == pytest.approx(nominal, rel=0.3)
    assert 0.025 / timestep == pytest.approx(round(0.025 / timestep))


def test_numbers_come_with_where_they_are_from(tmp_path):
    run, mean = a_run(tmp_path / "run", "finger", recordings={"dataset_hash": "abc"})
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    told = json.loads((out / "parameters.json").read_text())
    mass = told["parameters"]["spinner_mass"]
    assert (mass["mean"], mass["low"], mass["verdict"]) == (mean[0], mean[0] - 0.1, "weak")
    assert (mass["field"], mass["objects"]) == ("body_mass", ["spinner"])
    assert told["warnings"] == ["odd"]
    came = told["provenance"]
    assert (came["seed"], came["recordings"]["dataset_hash"]) == (3, "abc")
    assert came["versions"] == {"mujoco": "3"}
    # A world of them can be filmed.
    given = read_parameters(out / "parameters.json", load_task("finger").parameters)
    np.testing.assert_array_equal(given, mean)


def test_how_sure_the_numbers_are_is_printed(tmp_path):
    run, _ = a_run(tmp_path / "run", "finger")
    stored = json.loads((run / "result.json").read_text())
    first, *others = stored["parameters"]
    stored["parameters"][first]["verdict"] = "identified"
    write_json(run / "result.json", stored)
    assert how_sure(run) == [
        f"1 of {1 + len(others)} parameters identified",
        f"weak: {', '.join(others)}",
        "warning: odd",
    ]


# --- draws of the posterior -----------------------------------------------------------------


def a_run_with_a_posterior(path: Path, task_name: str) -> tuple[Path, Joint]:
    """Of curves that are normal, with the first two parameters correlated."""
    run, _ = a_run(path, task_name)
    space = load_task(task_name).parameters
    first, grid = Distribution.first(space, space.nominal), candidate_grid()
    curves = np.repeat(ndtr((0.5 - grid) / 0.05)[None], len(space), 0)
    correlation = np.eye(len(space))
    correlation[0, 1] = correlation[1, 0] = -0.9
    estimate = replace(read_curves(curves, first, first), correlation=correlation)
    joint = Joint.of(estimate, space)
    write_json(run / "curves.json", outcome.curves(estimate))
    draws = joint.draw(50, stream(3, Purpose.POSTERIOR))  # the run's seed
    np.savez(run / "posterior.npz", names=space.names, draws=draws, correlation=correlation)
    return run, joint


def test_delays_and_offsets_that_no_model_holds_are_written_beside_it(tmp_path):
    found = {"latency_steps": 2, "step_s": 0.05, "pictures_late_s": [0.01, 0.002]}
    found |= {
        "readings_late_s": [0.003, 0.001],
        "sensors": {"q.hip": {"unit": "rad", "offset": 0.2}},
    }
    for name, facts in (("timed", found), ("plain", {})):
        run, _ = a_run(tmp_path / name, "cartpole", **facts)
        out = export(ExportConfig(run_folder=run, out=tmp_path / f"{name}-out"))
        written = json.loads((out / "parameters.json").read_text())
        timed = name == "timed"
        assert written["late_s"] == pytest.approx(
            {"actions": 0.1 * timed, "pictures": 0.01 * timed, "readings": 0.003 * timed}
        )
        assert written["late_std_s"] == {"pictures": 0.002 * timed, "readings": 0.001 * timed}
        assert written["offsets"] == ({"q.hip": 0.2} if timed else {})


def test_samples_are_drawn_from_the_joint_posterior(tmp_path):
    run, joint = a_run_with_a_posterior(tmp_path / "run", "finger")
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out", samples=3000))
    assert (out / "model.xml").is_file()
    with (out / "samples.csv").open() as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == joint.space.names
    draws = np.array(rows, float)
    assert draws.shape == (3000, len(header))
    np.testing.assert_array_equal(draws, joint.space.clip(draws))
    np.testing.assert_allclose(
        np.quantile(joint.space.to_unit(draws), (0.05, 0.5, 0.95), axis=0),
        [joint.quantile(np.full(len(header), share)) for share in (0.05, 0.5, 0.95)],
        atol=0.005,
    )
    assert spearmanr(draws[:, :2]).statistic == pytest.approx(
        6 / np.pi * np.arcsin(-0.45), abs=0.02
    )
    with np.load(run / "posterior.npz") as file:
        np.testing.assert_allclose(draws[:50], file["draws"], rtol=1e-9)  # the run's own go first


def test_samples_alone_go_into_a_file_of_the_kind_that_its_ending_says(tmp_path):
    run, joint = a_run_with_a_posterior(tmp_path / "run", "finger")
    files = [tmp_path / "new" / f"samples{ending}" for ending in (".csv", ".npz", ".json")]
    for file in files:
        assert export(ExportConfig(run_folder=run, out=file, samples=7)) == file
    table = np.loadtxt(files[0], delimiter=",", skiprows=1)
    with np.load(files[1]) as found:
        assert tuple(found["names"]) == joint.space.names
        np.testing.assert_array_equal(found["draws"], table)
    rows = json.loads(files[2].read_text())
    assert rows == [dict(zip(joint.space.names, row, strict=True)) for row in table.tolist()]
    # Each of them is a world that can be filmed.
    (tmp_path / "world.json").write_text(json.dumps(rows[0]))
    world = read_parameters(tmp_path / "world.json", joint.space)
    np.testing.assert_array_equal(world, table[0])


_OF_A_RUN = ("config.json", "curves.json", "result.json")


def test_samples_that_cannot_be_written_are_refused_in_a_line(tmp_path):
    run, _ = a_run_with_a_posterior(tmp_path / "run", "finger")

    def refused(out: Path, samples: int | None = 5) -> str:
        with pytest.raises(InputError) as error:
            export(ExportConfig(run_folder=run, out=out, samples=samples))
        return str(error.value)

    assert "--samples must be at least 1" in refused(tmp_path / "out", 0)
    assert "give a folder" in refused(tmp_path / "draws.csv", None)
    (tmp_path / "mine.csv").touch()
    assert "is there already" in refused(tmp_path / "mine.csv")
    assert "cannot write" in refused(tmp_path / "mine.csv" / "draws.csv")
    whole = {name: json.loads((run / name).read_text()) for name in _OF_A_RUN}
    for name, spoilt in (
        ("curves.json", {"spinner_mass": {"candidates": [1, 2]}}),
        ("result.json", {k: v for k, v in whole["result.json"].items() if k != "task"}),
        ("result.json", {k: v for k, v in whole["result.json"].items() if k != "seed"}),
        ("config.json", {}),
    ):
        write_json(run / name, spoilt)
        assert f"{name} is damaged" in refused(tmp_path / "out")
        write_json(run / name, whole[name])
    (run / "posterior.npz").write_bytes(b"PK nonsense")
    assert "posterior.npz is damaged" in refused(tmp_path / "out")
    (run / "posterior.npz").unlink()
    assert "no posterior.npz" in refused(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_exported_is_said(scene, tmp_path):
    def refused(run: Path, out: Path = tmp_path / "out") -> str:
        with pytest.raises(InputError) as error:
            export(ExportConfig(run_folder=run, out=out))
        assert out.is_file() or not out.exists() or [p.name for p in out.iterdir()] == ["mine"]
        return str(error.value)

    assert "no run" in refused(tmp_path)
    ended, _ = a_run(tmp_path / "ended", str(scene))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    assert "not empty" in refused(ended, tmp_path / "full")
    (tmp_path / "file").touch()
    assert "cannot write" in refused(ended, tmp_path / "file")
    dr, _ = a_run(tmp_path / "dr", "cartpole", method="dr")
    assert "tunes nothing" in refused(dr)
    going_on, _ = a_run(tmp_path / "going_on", "cartpole")
    (going_on / "result.json").unlink()
    assert "no result yet" in refused(going_on)
    scene.write_text("# a comment is no change\n" + TUNING)
    assert "not empty" in refused(ended, tmp_path / "full")
    scene.write_text(TUNING.replace('"damping"', '"friction"'))
    assert "scene.toml or its model is not what" in refused(ended)
    scene.write_text(TUNING)
    model = next(scene.parent.glob("*.xml"))
    model.write_text(
        model.read_text().replace("<worldbody>", "<option gravity='0 0 -3'/><worldbody>")
    )
    assert "scene.toml or its model is not what" in refused(ended)
    scene.unlink()
    assert "scene.toml" in refused(ended)
