"""`export --format`: what training in other libraries reads, without those libraries."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest
import torch
from test_export import TUNING, a_run_with_a_posterior, scene, the_tuned_world

from simtune.config import ExportConfig
from simtune.errors import InputError
from simtune.export import export
from simtune.export.worlds import refuse_unfit
from simtune.parameters import ModelWriter
from simtune.tasks import load_task

__all__ = ["scene"]  # a fixture
EXAMPLE = Path(__file__).parents[2] / "examples" / "training"


def exported(tmp_path: Path, task: str, library: str) -> Path:
    run, _ = a_run_with_a_posterior(tmp_path / "run", task)
    config = ExportConfig(run_folder=run, out=tmp_path / "out", samples=6, format=library)
    return export(config)


def module_in(folder: Path, library: str) -> ModuleType:
    """The exported module, which knows nothing of simtune."""
    path = folder / f"{library}_worlds.py"
    assert "simtune." not in path.read_text()
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["finger", "scene"])
def test_playgrounds_worlds_are_those_that_the_run_would_simulate(
    name, scene, tmp_path, monkeypatch
):
    name = str(scene) if name == "scene" else name
    monkeypatch.setitem(sys.modules, "jax", ModuleType("jax"))
    out = exported(tmp_path, name, "playground")
    task = load_task(name)
    model = task.load_model()
    writer = ModelWriter(task.parameters, model)
    changed = module_in(out, "playground").changed_fields(model)
    draws = np.load(out / "worlds.npz")["draws"]
    assert len(draws) == 6
    for i, draw in enumerate(draws):
        world = task.load_model()
        writer.write(world, draw)
        for field, values in changed.items():
            owner = world.opt if field.startswith("opt.") else world
            # By the numbers that a file of doubles and singles keeps.
            expected = getattr(owner, field.removeprefix("opt."))
            np.testing.assert_allclose(values[i], expected, rtol=1e-6, atol=1e-9, err_msg=field)
    derived = {"body_subtreemass", "dof_invweight0"}
    assert set(writer.written) | derived <= set(changed) | {"body_inertia"}


def test_mjlabs_environments_each_get_a_whole_world(tmp_path, monkeypatch):
    out = exported(tmp_path, "finger", "mjlab")
    event_manager = ModuleType("mjlab.managers.event_manager")
    event_manager.EventTermCfg = SimpleNamespace
    event_manager.RecomputeLevel = SimpleNamespace(set_const=3)
    event_manager.requires_model_fields = lambda *fields, recompute: lambda function: function
    for module in ("mjlab", "mjlab.managers"):
        monkeypatch.setitem(sys.modules, module, ModuleType(module))
    monkeypatch.setitem(sys.modules, "mjlab.managers.event_manager", event_manager)
    event = module_in(out, "mjlab").tuned_worlds(prefix="robot/", mode="reset")
    assert event.mode == "reset"

    whole = mujoco.MjSpec()
    robot = load_task("finger").spec_for(0.04)
    whole.option = robot.option
    whole.attach(robot, prefix="robot/", frame=whole.worldbody.add_frame())
    model = whole.compile()
    fields = ("body_mass", "body_inertia", "dof_damping", "geom_rgba")
    batch = {f: torch.from_numpy(np.repeat(getattr(model, f)[None], 40, 0)) for f in fields}
    sim = SimpleNamespace(model=SimpleNamespace(**batch), mj_model=model)
    env = SimpleNamespace(num_envs=40, device="cpu", sim=sim)
    event.func(env, torch.arange(30))
    mass = batch["body_mass"][:, model.body("robot/spinner").id].numpy()
    damping = batch["dof_damping"][:, model.joint("robot/proximal").dofadr[0]].numpy()
    with np.load(out / "worlds.npz") as worlds:
        masses, dampings = worlds["draws"].T[:2]
    which = np.abs(mass[:30, None] - masses).argmin(1)
    assert set(which) == set(range(6))
    np.testing.assert_allclose(mass[:30], masses[which])
    np.testing.assert_allclose(damping[:30], dampings[which])
    nominal = model.body("robot/spinner").mass.item()
    np.testing.assert_array_equal(mass[30:], nominal)  # those were not asked for
    event.func(env, None)
    assert (mass[30:] != nominal).all()
    elsewhere = module_in(out, "mjlab").tuned_worlds(prefix="arm/")
    with pytest.raises(KeyError, match="arm/spinner"):
        elsewhere.func(env, None)


def test_the_scripts_module_knows_rows_of_every_kind(scene, tmp_path):
    """A ball joint has three, a hinge's angle stands elsewhere than its speed."""
    from simtune.export.training.rows import rows_of_object

    model = the_tuned_world(str(scene), np.full(TUNING.count("{name"), 1.0))
    assert rows_of_object(model, "dof", "ball").tolist() == [1, 2, 3]
    assert rows_of_object(model, "qpos0", "slide").tolist() == [0]
    assert rows_of_object(model, "body", "two").tolist() == [2]
    with pytest.raises(KeyError, match="elbow"):
        rows_of_object(model, "body", "elbow")


def test_what_does_not_fit_a_library_is_refused(scene, tmp_path):
    def refused(text: str, **asked) -> str:
        scene.write_text(text)
        run, _ = a_run_with_a_posterior(tmp_path / str(len(list(tmp_path.iterdir()))), str(scene))
        asked = {"samples": 5, "format": "mjlab", "out": tmp_path / "out"} | asked
        with pytest.raises(InputError) as error:
            export(ExportConfig(run_folder=run, **asked))
        assert not (tmp_path / "out").exists()
        return str(error.value)

    assert "mjlab has one opt.gravity for all worlds" in refused(TUNING)
    assert "needs --samples" in refused(TUNING, samples=None)
    assert "a folder as --out" in refused(TUNING, out=tmp_path / "worlds.npz")


@pytest.mark.parametrize(("name", "fits"), [("one", True), ("link 3", True), ("body 1", False)])
def test_an_object_needs_a_name_of_its_own(name, fits, scene):
    model = scene.parent / "scene.xml"
    own = f'name="{name}"' if fits else ""
    model.write_text(model.read_text().replace('name="one"', own))
    scene.write_text(TUNING.replace('"one"', f'"{name}"'))
    space = load_task(str(scene)).parameters
    if fits:
        refuse_unfit(space, "playground")
        return
    with pytest.raises(InputError, match="masses is of body 1, which has no name"):
        refuse_unfit(space, "playground")


@pytest.mark.slow
@pytest.mark.parametrize("library", ["mjlab", "playground"])
def test_a_task_of_the_library_itself_is_in_drawn_worlds(library, tmp_path):
    run, _ = a_run_with_a_posterior(tmp_path / "run", "cartpole")
    ended = subprocess.run(
        [EXAMPLE / "run.sh", library, run],
        capture_output=True,
        text=True,
        timeout=1500,
        env=os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert "16 environments, each in a world that was drawn" in ended.stdout
