"""The run folder: refusals, resuming, and what a crash may leave behind."""

import errno
import json
import math
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import SafetensorError

from simtune.errors import InputError
from simtune.experiment.run import Run
from simtune.randomization import Distribution
from simtune.run import checkpoint
from simtune.run.config import check_asked
from simtune.run.files import read_json, read_jsonl, write_atomically, write_json
from simtune.run.folder import RunFolder
from simtune.run.kept import kept_state
from simtune.run.real_episodes import read_real, write_real
from simtune.run.sources import source_of
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import unsure
from simtune.tuning.search import Event

CONFIG = {"task": "ball_in_cup", "seed": 1, "out": "a", "spm": {"width": 256, "dropout": 0.5}}
EVENT = Event("narrowed", "ball_mass", 0.1, 0.2, "clear")


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "runs" / "demo"


def _create(path: Path, **changes) -> RunFolder:
    """Of a run that goes on, as `Run` does once it has loaded a checkpoint."""
    run = RunFolder.create(path, CONFIG | changes)
    run.write_config()
    return run


def _log(run: RunFolder, *steps: int) -> None:
    for step in steps:
        run.logs.log_metrics(step, 2, step / 10, {"loss/spm": 0.5})
        run.logs.log_event(step, step / 10, asdict(EVENT))


def _steps(run: RunFolder, name: str = "metrics.jsonl") -> list[int]:
    return [line["step"] for line in read_jsonl(run.path / name)]


def test_config_is_written_with_versions(path):
    with _create(path) as run:
        assert not run.resumed
        assert run.load_checkpoint() is None
    stored = read_json(path / "config.json")
    assert stored["config"] == CONFIG
    names = {"simtune", "python", "mujoco", "mujoco_warp", "torch", "platform"}
    assert set(stored["versions"]) == names
    assert stored["versions"]["torch"] == version("torch")


def test_metrics_and_events(path):
    with _create(path) as run:
        run.logs.log_metrics(10, 2, 1.5, {"mean/ball_mass": np.float32(0.5), "loss/spm": math.nan})
        run.logs.log_event(10, 1.5, asdict(EVENT))
        line = json.loads((path / "metrics.jsonl").read_text())  # there before the run is closed
    assert line == {
        **{"step": 10, "real_episodes": 2, "wall_s": 1.5},
        **{"mean/ball_mass": 0.5, "loss/spm": None},
    }
    (event,) = read_jsonl(path / "events.jsonl")
    assert list(event) == ["step", "wall_s", "event", "parameter", "low", "high", "reason"]


def test_tensorboard_mirrors_the_scalars(path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with _create(path) as run:
        _log(run, 10, 20)
    events = EventAccumulator(str(path / "tensorboard"))
    events.Reload()
    assert [(e.step, e.value) for e in events.Scalars("loss/spm")] == [(10, 0.5), (20, 0.5)]


@pytest.mark.parametrize(
    ("prepare", "message"),
    [
        (lambda p: (p.parent.mkdir(), p.write_text("x")), "is a file: give --out a folder"),
        (lambda p: (p.mkdir(parents=True), (p / "x").touch()), "is not empty and no run"),
        (lambda p: p.parent.write_text("x"), "cannot write the run folder .*Not a directory"),
        (
            lambda p: (p.mkdir(parents=True), (p / "config.json").write_text("{")),
            r"config\.json is damaged",
        ),
    ],
)
def test_unusable_run_folders_are_refused(path, prepare, message):
    prepare(path)
    with pytest.raises(InputError, match=message) as caught:
        _create(path)
    assert "\n" not in str(caught.value)


def test_a_read_only_folder_is_refused(path, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)  # root may write anywhere, so chmod shows nothing
    with pytest.raises(InputError, match=r"cannot write the run folder .*: Permission denied"):
        _create(path)


def test_another_configuration_is_refused(path):
    _create(path).close()
    with pytest.raises(InputError, match=r"--seed 1, now 2: give the same values .* --out"):
        _create(path, seed=2)
    with pytest.raises(InputError, match=r"spm\.width = 256, now = 128"):
        _create(path, spm={"width": 128, "dropout": 0.5})
    with pytest.raises(InputError, match=r"renderer not set, now = 'opengl'"):
        _create(path, renderer="opengl")
    with pytest.raises(InputError, match=r"; .*; .* and 1 more"):
        _create(path, seed=2, task="walker", spm={"width": 1, "dropout": 0.1})
    assert read_json(path / "config.json")["config"] == CONFIG


def test_another_precision_is_named_as_it_is_typed(path):
    """config.json has it as a share."""
    _create(path, precision=0.07).close()
    with pytest.raises(InputError, match=r"--precision 7%, now 1%: give the same values"):
        _create(path, precision=0.01)


def test_what_has_the_same_content_may_lie_elsewhere(path):
    before = {"task": "tune.toml", "task_content": "4f", "real": "film", "real_parameters": None}
    _create(path, **before, recordings={"dataset_hash": "a1"}).close()
    now = {**before, "task": "/home/me/tune.toml", "real": "/data/film"}
    _create(path, **now, recordings={"dataset_hash": "a1"}).close()
    with pytest.raises(
        InputError, match=r"holds a run with other recordings than /data/film: give"
    ):
        _create(path, **now, recordings={"dataset_hash": "b2"})
    with pytest.raises(InputError, match=r"task = '/home/me/tune.toml', now = 'tune.toml'"):
        check_asked(path, {**CONFIG, "task": "tune.toml", "task_content": "5a"})


def test_a_run_keeps_its_sources_and_says_which_of_them_differ_wherever_they_lie(path, tmp_path):
    """Also beside the task's folder, as meshes are; a moved task is compared by content."""
    home, moved = tmp_path / "home", tmp_path / "moved"
    for name in ("arm/tune.toml", "arm/scene.xml", "parts/link.obj"):
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(name)
    files = [home / "arm/tune.toml", home / "arm/scene.xml", home / "parts/link.obj"]
    asked = {"task": str(files[0]), "task_content": "4f"}
    RunFolder.create(path, asked, files).close()
    stored = read_json(path / "config.json")
    assert [source_of(path, stored, str(file)) for file in files] == [
        str(path / "sources/home" / file.relative_to(home)) for file in files
    ]
    assert source_of(path, stored, "cartpole") == "cartpole"

    (home / "parts/link.obj").write_text("another")
    with pytest.raises(InputError, match=r"another content of \S+/link.obj \(its own: \S+\): give"):
        check_asked(path, asked | {"task_content": "5a"})
    RunFolder.create(path, asked, files).close()  # what it was made with stays
    assert (path / "sources/home/parts/link.obj").read_text() == "parts/link.obj"
    shutil.copytree(home, moved)
    with RunFolder.create(path, asked | {"task": str(moved / "arm/tune.toml")}, files) as run:
        run.write_config()
    stored = read_json(path / "config.json")  # went on with files elsewhere: its own are found
    assert source_of(path, stored, stored["config"]["task"]).startswith(str(path / "sources"))
    (moved / "arm/scene.xml").unlink()
    now = {"task": str(moved / "arm/tune.toml"), "task_content": "5a"}
    says = (
        r"holds a run with another content of (\S+)/arm/scene.xml and \1/parts/link.obj \(its own: "
    )
    with pytest.raises(InputError, match=says):
        check_asked(path, now)
    for other in (tmp_path / "other.toml", home / "arm/other.toml"):
        other.write_text("another task")
    for other in ("cartpole", str(tmp_path / "other.toml"), str(home / "arm/other.toml")):
        says = rf"run with task = '\S+/tune.toml', now = '{other}': give"
        with pytest.raises(InputError, match=says):
            check_asked(path, {"task": other, "task_content": "5a"})
    (home / "parts/link.obj").write_text("parts/link.obj")
    with pytest.raises(InputError, match=r"with another content of the task, as this version of"):
        check_asked(path, asked | {"task_content": "5a"})


@pytest.mark.parametrize(
    ("asked", "new", "default", "says"),
    [
        ({"search": "posterior"}, "image_size", None, "--image-size not given, now 32"),
        ({"method": "dr"}, "policy_steps", None, "--policy-steps not given, now 32"),
        ({"method": "dr"}, "real_gap", False, "--real-gap not given, now 32"),
    ],
)
def test_an_option_that_a_runs_version_did_not_have_counts_as_its_default(
    path, asked, new, default, says
):
    _create(path, **asked).close()
    _create(path, **asked, **{new: default}).close()
    _write_stored(path, lambda stored: stored["config"].pop(new))
    with pytest.raises(InputError, match=f"holds a run with {says}: give"):
        _create(path, **asked, **{new: 32})


def test_a_task_that_other_versions_read_otherwise_names_them(path):
    asked = {"task": "cartpole", "task_content": "4f"}
    _create(path, **asked).close()
    _write_stored(path, lambda stored: stored["versions"].update(mujoco="3.0.0"))
    with pytest.raises(InputError, match=r"or MuJoCo reads it \(mujoco 3.0.0 → [\d.]+\): give"):
        _create(path, **asked | {"task_content": "5a"})


def _write_stored(path: Path, change: Callable[[dict], object]) -> None:
    stored = read_json(path / "config.json")
    change(stored)
    write_json(path / "config.json", stored)


def test_a_run_killed_as_it_copied_its_sources_can_begin_anew(path, tmp_path):
    (tmp_path / "tune.toml").touch()
    (path / "sources").mkdir(parents=True)
    (path / "sources" / "half.xml").touch()
    RunFolder.create(path, CONFIG, [tmp_path / "tune.toml"]).close()
    assert [p.name for p in (path / "sources").rglob("*") if p.is_file()] == ["tune.toml"]


def test_the_same_configuration_resumes(path):
    _create(path).close()
    created = read_json(path / "config.json")["created"]
    with _create(path, out="b", budget_minutes=20) as run:
        assert run.resumed
    stored = read_json(path / "config.json")
    assert stored["created"] == created
    assert stored["config"]["budget_minutes"] == 20


def test_other_versions_are_reported(path, caplog):
    _create(path).close()
    stored = read_json(path / "config.json")
    stored["versions"]["torch"] = "1.0"
    write_json(path / "config.json", stored)
    _create(path).close()
    assert f"torch 1.0 → {version('torch')}" in caplog.text


def _an_experiment(path: Path) -> Any:
    space = load_task("cartpole").parameters
    return SimpleNamespace(
        config=SimpleNamespace(out=path),
        run_config=CONFIG,
        sources=(),
        search=SimpleNamespace(distribution=Distribution.first(space, space.nominal)),
        simulator=SimpleNamespace(num_steps=0, num_diverged=0),
        load=lambda tensors, state: None,
    )


def test_a_session_counts_from_its_beginning_and_those_before_it_as_well(path):
    """Libraries are loaded, and the real world is filmed, before a run's folder is opened."""
    experiment = _an_experiment(path)
    with Run(experiment, began_s=time.monotonic() - 30) as run:
        assert run.wall_s == pytest.approx(30, abs=5)
    estimate = unsure(experiment.search.distribution, "weak").to_json()
    state = {"step": 1, "rounds": 1, "sim_steps": 0, "num_diverged": 0, "estimate": estimate}
    with RunFolder.create(path, CONFIG, []) as folder:
        folder.save_checkpoint({"w": torch.zeros(1)}, state | {"wall_s": 200.0})
    with Run(experiment, began_s=time.monotonic() - 30) as run:
        run.resume()
        assert run.wall_s == pytest.approx(230, abs=5)


def test_a_run_that_these_versions_cannot_load_stays_as_another_made_it(path):
    estimate = {"shape": 1}
    state = {"step": 1, "rounds": 1, "sim_steps": 0, "num_diverged": 0, "estimate": estimate}
    with _create(path) as folder:
        folder.save_checkpoint({"w": torch.zeros(1)}, state | {"wall_s": 1.0})
    _write_stored(path, lambda stored: stored["versions"].update(torch="1.0"))
    before = (path / "config.json").read_text()
    with Run(_an_experiment(path)) as run, pytest.raises(InputError, match="has other fields"):
        run.resume()
    assert (path / "config.json").read_text() == before


def test_one_process_at_a_time(path):
    run = _create(path)
    with pytest.raises(InputError, match="still going"):
        _create(path)
    run.close()
    _create(path).close()


def test_checkpoint_comes_back_as_it_was(path):
    weights = torch.randn(3, 4, dtype=torch.bfloat16)
    tensors = {
        "w": weights,
        "tied": weights,
        "view": weights.T,
        "n": torch.tensor(7),
        "e": torch.empty(0),
    }
    rng = np.random.default_rng(1)
    state = {"step": 5, "rng": rng.bit_generator.state, "best": math.inf}
    with _create(path) as run:
        run.save_checkpoint(tensors, state)
    with _create(path) as run:
        loaded = run.load_checkpoint()
    assert loaded is not None
    assert loaded[1] == state
    assert set(loaded[0]) == set(tensors)
    for name, tensor in tensors.items():
        assert torch.equal(loaded[0][name], tensor)


def test_a_full_disk_keeps_the_former_checkpoint_and_says_the_way_on(path, monkeypatch):
    def full(tensors, file):
        file.write_bytes(b"half")
        raise SafetensorError("I/O error: No space left on device (os error 28)")

    with _create(path) as run:
        run.save_checkpoint({"a": torch.ones(2)}, {"step": 1})
        monkeypatch.setattr("safetensors.torch.save_file", full)
        words = r"cannot write the checkpoint .*000002: .*No space left.*make room.* goes on"
        with pytest.raises(RuntimeError, match=words):
            run.save_checkpoint({"a": torch.ones(2)}, {"step": 2})
        assert [p.name for p in (path / "checkpoints").iterdir()] == ["000001"]
    assert kept_state(path)["step"] == 1


def test_a_checkpoint_that_cannot_take_its_place_leaves_nothing_behind(path, monkeypatch):
    def refuse(source, target):
        if Path(target).name.isdigit():
            raise OSError(errno.EIO, "Input/output error")
        replace(source, target)

    replace = os.replace
    with _create(path) as run:
        run.save_checkpoint({}, {"step": 1})
        monkeypatch.setattr("os.replace", refuse)
        with pytest.raises(RuntimeError, match=r"cannot write .*000002: .*Input/output error"):
            run.save_checkpoint({}, {"step": 2})
        assert [p.name for p in (path / "checkpoints").iterdir()] == ["000001"]
    (blocked := path.parent / "file").touch()
    with pytest.raises(RuntimeError, match=r"cannot write the checkpoint .*000001: .*File exists"):
        checkpoint.save(blocked, {}, {})


def test_an_old_checkpoint_that_cannot_be_removed_stays_with_a_warning(path, monkeypatch, caplog):
    def refuse(path, ignore_errors=False):
        if not ignore_errors:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))

    with _create(path) as run:
        for step in range(2):
            run.save_checkpoint({}, {"step": step})
        monkeypatch.setattr("shutil.rmtree", refuse)
        run.save_checkpoint({}, {"step": 2})
    assert "000001 cannot be removed, and stays" in caplog.text
    assert kept_state(path)["step"] == 2


def test_latest_two_checkpoints_are_kept(path):
    with _create(path) as run:
        for step in range(4):
            run.save_checkpoint({}, {"step": step})
        assert sorted(p.name for p in (path / "checkpoints").iterdir()) == ["000003", "000004"]


@pytest.mark.parametrize("damage", ["flip", "truncate", "no manifest", "bad manifest"])
def test_damaged_checkpoint_falls_back_and_says_so(path, caplog, damage):
    with _create(path) as run:
        for step in (1, 2):
            _log(run, step)
            run.save_checkpoint({"w": torch.full((100,), float(step))}, {"step": step})
    newest = path / "checkpoints" / "000002"
    tensors, manifest = newest / "tensors.safetensors", newest / "manifest.json"
    if damage == "flip":
        content = bytearray(tensors.read_bytes())
        content[-1] ^= 1
        tensors.write_bytes(content)
    elif damage == "truncate":
        tensors.write_bytes(tensors.read_bytes()[:-50])
    elif damage == "no manifest":
        manifest.unlink()
    else:
        manifest.write_text('{"sha256": []}')
    with _create(path) as run:
        loaded = run.load_checkpoint()
        assert loaded is not None
        assert loaded[1]["step"] == 1
        assert torch.equal(loaded[0]["w"], torch.ones(100))
        assert _steps(run) == [1]
        run.save_checkpoint({}, {"step": 2})
        assert (path / "checkpoints" / "000002").is_dir()
    assert caplog.text.count("000002 is damaged") == 1


def test_logs_are_cut_at_the_checkpoint(path):
    with _create(path) as run:
        _log(run, 10, 20)
        run.save_checkpoint({}, {"step": 20})
        _log(run, 30, 40)
    for name in ("metrics.jsonl", "events.jsonl"):
        with (path / name).open("a") as file:
            file.write('{"step": 15, "real_ep')
    with _create(path) as run:
        assert _steps(run) == _steps(run, "events.jsonl") == [10, 20]
        _log(run, 30)
        assert _steps(run) == [10, 20, 30]


def test_lines_of_the_same_step_after_the_checkpoint_are_not_kept(path):
    with _create(path) as run:
        _log(run, 0)
        run.save_checkpoint({}, {"step": 0})
        _log(run, 0)  # killed before the next checkpoint: it comes again
    with _create(path) as run:
        assert _steps(run) == _steps(run, "events.jsonl") == [0]
        _log(run, 0)
        run.save_checkpoint({}, {"step": 0})
    with _create(path) as run:
        assert _steps(run) == [0, 0]


def test_without_a_checkpoint_the_logs_start_anew(path):
    with _create(path) as run:
        _log(run, 0, 10)
    with _create(path) as run:
        assert run.resumed
        assert _steps(run) == []


def test_a_kill_between_writing_and_renaming_keeps_the_former_files(path, monkeypatch):
    """Whatever the moment, the old file and the old checkpoint stay whole."""

    def killed(*_):
        raise KeyboardInterrupt

    with _create(path) as run:
        run.write_result({"task": "old"})
        run.save_checkpoint({"w": torch.ones(2)}, {"step": 1})
        with monkeypatch.context() as patch:
            patch.setattr(os, "replace", killed)
            with pytest.raises(KeyboardInterrupt):
                run.write_result({"task": "new"})
            with pytest.raises(KeyboardInterrupt):
                run.save_checkpoint({"w": torch.zeros(2)}, {"step": 2})
    assert read_json(path / "result.json") == {"task": "old"}
    with _create(path) as run:
        loaded = run.load_checkpoint()
        assert loaded is not None
        assert loaded[1] == {"step": 1}
        run.save_checkpoint({}, {"step": 2})
        assert sorted(p.name for p in (path / "checkpoints").iterdir()) == ["000001", "000002"]


def test_a_run_killed_before_its_first_config_can_begin_anew(path):
    path.mkdir(parents=True)
    (path / ".config.json.tmp").write_text("{")
    with _create(path) as run:
        assert not run.resumed


def test_write_atomically_replaces(tmp_path):
    for content in ("old", b"new"):
        write_atomically(tmp_path / "x", content)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("x", "new")]


def test_a_full_disk_leaves_no_part_of_a_file(tmp_path, monkeypatch):
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*x'"):
        write_atomically(tmp_path / "x", "new")
    assert not list(tmp_path.iterdir())


def test_a_damaged_film_of_the_real_world_is_refused_as_damaged(tmp_path):
    with RunFolder.create(tmp_path / "run", {}) as run:
        film = Trajectory(np.zeros((3, 8, 8, 3), np.uint8), np.zeros((2, 1), np.float32), 0.1)
        write_real(run.path, 0, [film])
        assert len(read_real(run.path, 0, 0.1)[0]) == 2
        path = tmp_path / "run/real/000.safetensors"
        path.write_bytes(path.read_bytes()[:-3])
        with pytest.raises(InputError, match=r"000\.safetensors is damaged .* cannot be filmed"):
            read_real(run.path, 0, 0.1)
