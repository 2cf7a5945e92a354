"""Grids of runs: what is asked for, and that each is done once, whatever is killed."""

import json
import multiprocessing
import os
import pickle
import posix
import random
import re
import shlex
import shutil
import signal
import sys
import threading
import time
from dataclasses import replace
from multiprocessing import forkserver
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from sweep_driver import STAND_IN, drive_quietly

from simtune.config import SweepConfig
from simtune.errors import InputError
from simtune.experiment import outcome
from simtune.experiment.enough_time import refuse_if_too_short
from simtune.parameters.values_file import read_parameters
from simtune.real.truth import Truth
from simtune.recordings import dataset, open_dataset
from simtune.run.files import write_json
from simtune.sweep import dry_run, sweep
from simtune.sweep.asked import AskedRun
from simtune.sweep.attempt import _LONGEST_REASON, _TOO_SHORT
from simtune.sweep.board import Board
from simtune.sweep.estimate import Expectation, seconds_left
from simtune.sweep.grid import read_grid
from simtune.sweep.lease import Lease, cores_taken
from simtune.sweep.pilot import Pilot, Pilots
from simtune.sweep.standing import Places, Standing
from simtune.sweep.sweep import open_sweep
from simtune.tasks import load_task
from simtune.tuning.search import TimeNeeded

GRID = """
[options]
budget_minutes = 2

[[runs]]
command = "tune"
task = "cartpole"
seed = SEEDS
"""


@pytest.fixture
def beside(tmp_path, monkeypatch) -> Path:
    """A folder for what stand-ins note, and two cores to run on, whatever there are."""
    monkeypatch.setenv("STAND_IN", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # other tests' sweeps hold cores of theirs
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr(os, "sched_getaffinity", posix.sched_getaffinity)  # see conftest.py
    return tmp_path


def grid(folder: Path, seeds: object, text: str = GRID) -> Path:
    path = folder / "grid.toml"
    path.write_text(text.replace("SEEDS", str(seeds)))
    return path


def lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.exists() else []


def begun(folder: Path) -> list[str]:
    return lines(folder / "begun")


def entries(out: Path) -> dict[str, dict]:
    return {run["name"]: run for run in json.loads((out / "sweep.json").read_text())["runs"]}


# --- grids --------------------------------------------------------------------------------


def runs_of(tmp_path: Path, text: str) -> list[AskedRun]:
    return read_grid(grid(tmp_path, [0], text))


def test_lists_are_multiplied_out_and_low_seeds_come_first(tmp_path):
    runs = runs_of(
        tmp_path,
        """
        [[runs]]
        command = "train"
        task = ["cartpole", "finger"]
        method = ["dr", "oracle"]
        seed = [1, 0]
        skip = [{task = "finger", method = "oracle"}]
        [[runs]]
        name = "episodes"
        command = "tune"
        task = "cartpole"
        start_factor = [1.5, 1]
        real_gap = true
        """,
    )
    assert [run.name for run in runs] == [
        "cartpole-dr-s0",
        "cartpole-oracle-s0",
        "finger-dr-s0",
        "episodes-cartpole-tune-start_factor=1.5-s0",
        "episodes-cartpole-tune-start_factor=1-s0",
        "cartpole-dr-s1",
        "cartpole-oracle-s1",
        "finger-dr-s1",
    ]
    assert runs[0].arguments(Path("/x"))[:4] == ["train", "cartpole", "--out", "/x"]
    assert runs[0].arguments(Path("/x"))[4:] == ["--method", "dr", "--seed", "0"]
    assert runs[3].arguments(Path("/x"))[4:] == ["--start-factor", "1.5", "--real-gap"]
    assert runs[0].kind == runs[5].kind != runs[1].kind


def test_files_are_found_beside_the_grid(tmp_path):
    (tmp_path / "truth.json").write_text("{}")
    text = '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nreal_parameters = "truth.json"\n'
    (run,) = runs_of(tmp_path, text)
    assert str(tmp_path / "truth.json") in run.arguments(Path("x"))
    assert run.asked["real_parameters"] == "truth.json"  # the folder may move


def test_a_users_home_is_found(tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    (home / "truth.json").write_text("{}")
    example = Path(__file__).parents[2] / "examples" / "cart_pendulum"
    shutil.copytree(example, home / "cart", ignore=shutil.ignore_patterns("recordings"))
    monkeypatch.setenv("HOME", str(home))
    text = '[[runs]]\ncommand = "tune"\ntask = "~/cart/tune.toml"\nreal_parameters = "~/truth.json"'
    (run,) = runs_of(tmp_path, text)
    assert {str(home / "truth.json"), str(home / "cart/tune.toml")} < set(run.arguments(Path("x")))
    assert run.name == "cart-tune-s0"


def test_whatever_is_varied_has_a_name_of_its_own(tmp_path):
    example = Path(__file__).parents[2] / "examples" / "cart_pendulum"
    for copy in ("left", "right", "my arm"):
        shutil.copytree(example, tmp_path / copy, ignore=shutil.ignore_patterns("recordings"))
    text = """
        [[runs]]
        command = "tune"
        task = ["left/tune.toml", "right/tune.toml"]
        precision = ["1%", "5%"]
        [[runs]]
        command = "tune"
        task = "my arm/tune.toml"
        observe = ["cameras", " cameras , cameras"]
        real = ["left", "pseudo"]
        """
    runs = runs_of(tmp_path, text)
    assert [run.name for run in runs] == [
        "left-tune-precision=1-s0",
        "left-tune-precision=5-s0",
        "right-tune-precision=1-s0",
        "right-tune-precision=5-s0",
        "my_arm-tune-observe=cameras-real=left-s0",
        "my_arm-tune-observe=cameras-real=pseudo-s0",
        "my_arm-tune-observe=cameras_cameras-real=left-s0",
        "my_arm-tune-observe=cameras_cameras-real=pseudo-s0",
    ]
    rows = [line.split("  ")[0] for line in Board(tmp_path, runs, 0, 1).table()]
    assert rows[1:4] == ["left tune", "right tune", "my arm tune"]


@pytest.mark.parametrize(("width", "height", "tasks"), [(40, 8, 4), (200, 3, 0), (200, 30, 10)])
def test_a_live_table_leaves_no_copies_on_a_terminal_that_is_too_small_for_it(
    tmp_path, monkeypatch, capsys, width, height, tasks
):
    runs = [
        AskedRun(name=f"run{i}", command="tune", options={"task": f"task{i}.toml"}, folder=tmp_path)
        for i in range(10)
    ]
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setattr("simtune.sweep.board._terminal", lambda: (width, height))
    board = Board(tmp_path, runs, 0, 1)
    for run in runs[5:8]:
        board.begin(run)
    lines = on_terminal(capsys.readouterr().err, width, height)
    assert [line[:15] for line in lines if "runs done" in line] == ["0 of 10 runs do"]
    assert sum(line.startswith("task") for line in lines) == tasks
    assert ("and 6 rows more" in lines) == (tasks == 4)
    if tasks:
        assert {"task5", "task6", "task7"} <= {line[:5] for line in lines}, "those that run"


def on_terminal(text: str, width: int, height: int) -> list[str]:
    """Lines that a terminal shows or has scrolled away, after text that moves its cursor up."""
    lines = [""]
    for part in re.split(r"(\x1b\[\d+F\x1b\[J|\n)", text):
        if part == "\n":
            lines.append("")
        elif part.startswith("\x1b"):
            up = int(re.findall(r"\d+", part)[0])
            lines = [*lines[: max(len(lines) - 1 - up, len(lines) - height)], ""]
        elif part:
            lines[-1:] = [part[i : i + width] for i in range(0, len(part), width)]
    return lines


def test_the_docs_own_grid_is_one(tmp_path):
    root = Path(__file__).parents[2]
    text = (root / "docs" / "sweeps.md").read_text().split("```toml\n")[1].split("```")[0]
    example = root / "examples" / "cart_pendulum"
    for name in ("scene.xml", "policy.py"):
        shutil.copy(example / name, tmp_path)
    shutil.copy(example / "tune.toml", tmp_path / "my_robot.toml")
    runs = runs_of(tmp_path, text)
    assert len(runs) == 2 * 4 * 3 - 3 + 4 * 3
    assert {run.options["start_factor"] for run in runs} == {3}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("seed = 1", "grid.toml:1: no key 'seed' in the file; there are: options, runs"),
        ("[options]\nseed = 1", "it asks for no runs"),
        ('[[runs]]\ncommand = "tuna"', "did you mean 'tune'"),
        ('[[runs]]\ncommand = "tune"', "task is missing"),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpol"', "did you mean 'cartpole'"),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nsede = [0, 1]',
            "grid.toml:4: no option 'sede' in simtune tune; did you mean 'seed'",
        ),
        (
            '[options]\nname = "a"\n[[runs]]\ncommand = "tune"\ntask = "cartpole"',
            "grid.toml:2: no option 'name' in simtune tune",
        ),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nseed = "a"',
            "--seed must be a whole n",
        ),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\nseed = -1', "--seed must not be negative"),
        (
            '[[runs]]\ncommand = "train"\ntask = "cartpole"\nmethod = ["autotune", "dr"]\n'
            "real_episodes = 2",
            "grid.toml:1: --real-episodes goes with --method autotune or regression",
        ),
        (
            '[[runs]]\ncommand = "train"\ntask = "cartpole"\nmethod = "rd"',
            "dr, untuned or oracle, got 'rd'",
        ),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nprecision = 0.01',
            "--precision must be text such as '1%', got 0.01",
        ),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\njson = true', "no option 'json'"),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\nreal = "none"', "none: no such folder"),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\nname = "a/b"', "letters, digits and _"),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\nseed = []', "it asks for no runs: a list"),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nskip = [{task = "cartpole"}]',
            "or skip leaves none",
        ),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nseed = [0, 1]\nskip = [{seed = 7}]',
            "no run of this block has what skip asks for: {'seed': 7}",
        ),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\nskip = [{gap = 1}]', "skip asks for gap"),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\n'
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nreal_episodes = 2',
            "cartpole-tune-s0, of another real_episodes: put them into two blocks, and give one of",
        ),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\nobserve = "foo"', "no sensor 'foo' in"),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nknown_colour = "nope"',
            "no colour 'nope'",
        ),
        ('[[runs]]\ncommand = "tune"\ntask = "cartpole"\ndevice = "gpu"', "cpu, cuda or cuda:N"),
        (
            '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nreal_parameters = "grid.toml"',
            "grid.toml is not JSON",
        ),
    ],
)
def test_what_a_command_would_refuse_is_said_before_anything_runs(tmp_path, text, complaint):
    with pytest.raises(InputError) as error:
        runs_of(tmp_path, text)
    assert complaint in str(error.value)
    assert "grid.toml:" in str(error.value)


def test_a_training_without_a_reward_is_refused_before_anything_runs(tmp_path):
    shutil.copytree(Path(__file__).parents[2] / "examples" / "phone_pendulum", tmp_path / "phone")
    text = '[[runs]]\ncommand = "{}"\ntask = "phone/tune.toml"\n'
    runs_of(tmp_path, text.format("tune"))
    with pytest.raises(InputError, match=r"grid.toml:1: phone_pendulum has no reward"):
        runs_of(tmp_path, text.format("train"))


# --- leases -------------------------------------------------------------------------------


def test_a_lease_is_one_holders_until_it_is_given_back(tmp_path):
    lease = Lease.take(tmp_path / "lock")
    assert lease is not None
    assert Lease.take(tmp_path / "lock") is None
    lease.close()
    again = Lease.take(tmp_path / "lock")
    assert again is not None
    again.close()


def test_cores_are_nobody_elses_meanwhile(beside, monkeypatch):
    said: list[str] = []
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5, 8})
    with cores_taken(2, said.append) as first, cores_taken(1, said.append) as second:
        assert (first, second) == ([3, 5], [8])
    with cores_taken(3, said.append) as all_of_them:
        assert all_of_them == [3, 5, 8]
        # What waits for them ends when the sweep does.
        asked = iter([False, True])
        with cores_taken(1, said.append, lambda: next(asked)) as none:
            assert none == []
    assert said == ["waiting for a core of 3, 5, 8 that no other sweep is on"]


# --- sweeps -------------------------------------------------------------------------------


def cores() -> int:
    return len(os.sched_getaffinity(0))


def test_every_run_is_done_once_and_not_again(beside):
    config = SweepConfig(grid=grid(beside, [0, 1, 2]), out=beside / "out", workers=1)
    assert {s.status for s in sweep(config, STAND_IN).values()} == {"done"}
    assert len(begun(beside)) == 3
    sweep(config, STAND_IN)  # there is nothing left
    sweep(SweepConfig(**vars(config) | {"grid": grid(beside, [0, 1, 2, 3])}), STAND_IN)
    assert len(begun(beside)) == 4
    entry = entries(beside / "out")["cartpole-tune-s2"]
    assert entry["asked"] == {
        "command": "tune",
        "budget_minutes": 2,
        "task": "cartpole",
        "seed": 2,
    }
    assert entry["scores"] == {"percent_error": 0.2, "wall_s": 0.2}
    assert (entry["status"], entry["failures"], entry["kills"]) == ("done", 0, 0)
    assert entry["spent_s"] > 0.2


class Elsewhere:
    """In place of Ray: another machine, on which Python lies at `python`."""

    def __init__(self, python: Path):
        self._python = python

    def init(self, **options):
        pass

    def cluster_resources(self) -> dict:
        return {"CPU": 1}

    def remote(self, **options):
        return lambda task: SimpleNamespace(remote=lambda *args: pickle.dumps((task, args)))

    def wait(self, queue, num_returns):
        return queue[:1], queue[1:]

    def get(self, sent):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "executable", str(self._python))
            task, arguments = pickle.loads(sent)
            return task(*arguments)

    def shutdown(self):
        pass


def test_another_machine_runs_its_own_simtune(beside, monkeypatch):
    """A driver's interpreter need not be there."""
    python = beside / "python"
    python.write_text(
        f'#!/bin/sh\n[ $1 = -m ] || exec {sys.executable} "$@"\n'
        f'[ $2 = simtune ] && shift 2 && exec {shlex.join(STAND_IN)} "$@"\n'
    )
    python.chmod(0o755)
    monkeypatch.setitem(sys.modules, "ray", Elsewhere(python))
    (standing,) = sweep(SweepConfig(grid=grid(beside, [7]), out=beside / "out", ray="it")).values()
    assert (standing.status, len(begun(beside))) == ("done", 1)


def test_a_run_is_bound_to_one_core(beside):
    sweep(SweepConfig(grid=grid(beside, [0]), out=beside / "out"), STAND_IN)
    (line,) = begun(beside)
    assert line.split()[-1].isdigit()


def test_a_failed_run_is_retried_and_then_listed_with_its_reason(beside):
    config = SweepConfig(grid=grid(beside, [1013, 0]), out=beside / "out", workers=1, retries=2)
    sweep(config, STAND_IN)
    assert len(begun(beside)) == 1 + 3
    failed = entries(beside / "out")["cartpole-tune-s1013"]
    assert (failed["status"], failed["failures"]) == ("failed", 3)
    assert failed["reason"] == "exit status 1: simtune: unlucky"
    assert entries(beside / "out")["cartpole-tune-s0"]["status"] == "done"
    sweep(config, STAND_IN)
    assert len(begun(beside)) == 4  # it is not tried for ever
    sweep(SweepConfig(**vars(config) | {"retries": 3}), STAND_IN)
    assert len(begun(beside)) == 5


def test_a_run_that_finds_its_input_unusable_is_tried_once(beside):
    config = SweepConfig(grid=grid(beside, [1015]), out=beside / "out", retries=2)
    (standing,) = sweep(config, STAND_IN).values()
    assert (standing.status, standing.failures, len(begun(beside))) == ("failed", 3, 1)
    assert standing.reason == "exit status 2: simtune: no such recordings"
    sweep(replace(config, retries=3), STAND_IN)
    assert len(begun(beside)) == 2


def test_minutes_that_are_too_short_on_a_busy_machine_are_tried_again(beside):
    config = SweepConfig(grid=grid(beside, [1016]), out=beside / "out", retries=2)
    (standing,) = sweep(config, STAND_IN).values()
    assert (standing.status, standing.failures, len(begun(beside))) == ("failed", 3, 3)
    (beside / "idle").touch()
    (standing,) = sweep(replace(config, retries=3), STAND_IN).values()
    assert (standing.status, len(begun(beside))) == ("done", 4)


def test_a_run_that_has_not_begun_may_get_more_minutes(beside):
    config = SweepConfig(grid=grid(beside, [1016]), out=beside / "out", retries=0)
    (standing,) = sweep(config, STAND_IN).values()
    assert (standing.status, standing.failures) == ("failed", 1)
    more = GRID.replace("budget_minutes = 2", "budget_minutes = 3")
    places = Places(config.out, "cartpole-tune-s1016")
    lease = Lease.take(places.lease)
    assert lease
    grid(beside, [1016], more)
    with pytest.raises(InputError, match="s1016 of another budget_minutes"):
        sweep(config, STAND_IN)  # a process has it
    lease.close()
    (standing,) = sweep(config, STAND_IN).values()
    assert (standing.status, standing.failures) == ("done", 0)
    assert entries(config.out)["cartpole-tune-s1016"]["asked"]["budget_minutes"] == 3


@pytest.mark.parametrize("whole_s", [0.0, 300.0])
def test_a_sweep_knows_the_words_that_refuse_a_time_too_short(whole_s):
    with pytest.raises(InputError) as error:
        refuse_if_too_short(0.5, 100.0, TimeNeeded(whole_s / 5, whole_s))
    assert _TOO_SHORT.search(str(error.value)[:_LONGEST_REASON])


def test_runs_of_another_grid_in_the_same_folder_stay_listed(beside):
    for seeds in ([1013], [0]):
        sweep(SweepConfig(grid=grid(beside, seeds), out=beside / "out", retries=0), STAND_IN)
    found = entries(beside / "out")
    assert [run["status"] for run in found.values()] == ["done", "failed"]
    assert found["cartpole-tune-s1013"]["reason"] == "exit status 1: simtune: unlucky"


def test_a_full_disk_is_waited_for_and_counts_as_no_failure(beside):
    config = SweepConfig(grid=grid(beside, [1014]), out=beside / "out", retries=0)

    def make_room() -> None:
        wait_for(lambda: lines(beside / "full"))
        (beside / "room").touch()

    thread = threading.Thread(target=make_room)
    thread.start()
    (standing,) = sweep(config, STAND_IN).values()
    thread.join()
    assert (standing.status, standing.failures) == ("done", 0)
    assert len(begun(beside)) >= 2


def test_a_name_stands_for_one_run_for_ever(beside):
    config = SweepConfig(grid=grid(beside, [0]), out=beside / "out")
    sweep(config, STAND_IN)
    grid(beside, [0], GRID.replace("budget_minutes = 2", "budget_minutes = 3"))
    with pytest.raises(InputError, match="has a run cartpole-tune-s0 of another budget_minutes"):
        sweep(config, STAND_IN)


def test_a_run_of_another_content_of_its_task_is_not_taken_for_done(tmp_path, beside):
    example = Path(__file__).parents[2] / "examples" / "cart_pendulum"
    shutil.copytree(example, tmp_path / "cart", ignore=shutil.ignore_patterns("recordings"))
    tuning = tmp_path / "cart" / "tune.toml"
    text = '[[runs]]\ncommand = "tune"\ntask = "cart/tune.toml"\n'
    config = SweepConfig(grid=grid(tmp_path, [0], text), out=beside / "out")
    (run,) = open_sweep(config)
    folder = Places(config.out, run.name).run
    folder.mkdir(parents=True)
    stored = {"config": outcome.asked(run.config(), load_task(str(tuning))), "sources": None}
    write_json(folder / "config.json", stored)
    assert open_sweep(config)
    tuning.write_text(tuning.read_text().replace("step_s = 0.05", "step_s = 0.1"))
    with pytest.raises(InputError, match="another content of"):
        open_sweep(config)


def begun_run(config: SweepConfig, real: str, contents: dict) -> None:
    """The folder of the grid's run, with the config.json that it would have."""
    (run,) = open_sweep(config)
    folder = Places(config.out, run.name).run
    folder.mkdir(parents=True)
    stored = outcome.asked(run.config(), load_task("cartpole")) | contents | {"real": real}
    write_json(folder / "config.json", {"config": stored, "sources": None})
    assert open_sweep(config)


def test_a_run_of_another_truth_is_not_taken_for_done(tmp_path, beside):
    truth, space = tmp_path / "truth.json", load_task("cartpole").parameters
    truth.write_text('{"pole_mass": 0.1}')
    text = '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nreal_parameters = "truth.json"\n'
    config = SweepConfig(grid=grid(tmp_path, [0], text), out=beside / "out")
    digest = Truth(space, read_parameters(truth, space)).digest
    begun_run(config, "pseudo", {"truth": digest, "real_parameters": str(truth)})
    truth.write_text('{"pole_mass": 0.3}')
    with pytest.raises(InputError, match="holds a run with other values in --real-parameters"):
        open_sweep(config)
    truth.write_text('{"pole_mass": 1e-1}')  # the same in other words
    assert open_sweep(config)


def test_a_run_of_other_recordings_is_not_taken_for_done(tmp_path, beside, monkeypatch):
    episode = {"frames": np.zeros((9, 16, 16, 3), np.uint8), "actions": np.ones((9, 1)), "hz": 12.5}
    files = [tmp_path / "film" / f"episode_{i}.npz" for i in range(2)]
    files[0].parent.mkdir()
    np.savez(files[0], **episode)
    text = '[[runs]]\ncommand = "tune"\ntask = "cartpole"\nreal = "film"\nseed = SEEDS\n'
    config = SweepConfig(grid=grid(tmp_path, [0], text), out=beside / "out")
    read = {"recordings": {"dataset_hash": open_dataset(files[0].parent).content_hash}}
    begun_run(config, str(files[0].parent), read)
    grid(tmp_path, [0, 1], text)
    first, second = (Places(config.out, f"cartpole-tune-s{i}").run for i in range(2))
    stored = json.loads((first / "config.json").read_text())
    second.mkdir()
    write_json(second / "config.json", stored | {"config": stored["config"] | {"seed": 1}})
    read_as: list[object] = []
    fingerprint = dataset.fingerprint
    monkeypatch.setattr(dataset, "fingerprint", lambda *a: read_as.append(a) or fingerprint(*a))
    assert open_sweep(config)
    assert len(read_as) == 1  # once for all runs: there may be terabytes
    np.savez(files[1], **episode)
    with pytest.raises(InputError, match=r"holds a run with other recordings than \S+film: give"):
        open_sweep(config)
    write_json(first / "config.json", stored | {"config": stored["config"] | {"recordings": None}})
    write_json(second / "config.json", stored | {"config": stored["config"] | {"seed": 1}})
    with pytest.raises(InputError, match="s1 holds a run with other recordings"):
        open_sweep(config)  # the first has read none, as some trainings


def test_minutes_of_pilots_go_with_a_dry_run(beside):
    config = SweepConfig(grid=grid(beside, [0]), out=beside / "out", pilot_minutes=5)
    with pytest.raises(InputError, match="--pilot-minutes goes with --dry-run only"):
        sweep(config, STAND_IN)


@pytest.mark.parametrize("minutes", [0.0, -1.0, float("inf"), float("nan")])
def test_a_pilot_takes_some_minutes_and_ends(beside, minutes):
    config = SweepConfig(
        grid=grid(beside, [0]), out=beside / "out", dry_run=True, pilot_minutes=minutes
    )
    with pytest.raises(InputError, match="--pilot-minutes: a number above 0"):
        sweep(config, STAND_IN)


def test_more_workers_than_cores_are_refused(beside):
    config = SweepConfig(grid=grid(beside, [0]), out=beside / "out", workers=10_000)
    with pytest.raises(InputError, match="10000 runs at a time on 1 cores each need more than"):
        sweep(config, STAND_IN)


def test_ctrl_c_ends_the_runs_and_the_same_command_goes_on(beside, start_driver):
    driver = start_driver(beside, range(3), 1)
    wait_for(lambda: len(begun(beside)) == 1)
    os.kill(driver.pid, signal.SIGINT)
    assert ended(driver) != 0
    (line,) = begun(beside)
    wait_for(lambda: not is_alive(int(line.split()[1])))
    assert entries(beside / "out")["cartpole-tune-s0"]["failures"] == 0
    assert ended(start_driver(beside, range(3), 1)) == 0
    assert not lines(beside / "doubled")


# --- kills --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def start_driver():
    """Starts a sweep, forked from a process that has done its imports, which take seconds."""
    forked = multiprocessing.get_context("forkserver")
    forked.set_forkserver_preload(["simtune.sweep"])
    forkserver.ensure_running()  # before a test has a TMPDIR, too long for a socket's name

    def start(folder: Path, seeds: range, workers: int) -> BaseProcess:
        names = ("STAND_IN", "TMPDIR", "STAND_IN_STEP_S")
        environment = {name: os.environ[name] for name in names if name in os.environ}
        path = grid(folder, list(seeds)).rename(folder / f"grid{seeds.start}.toml")
        given = (path, folder / "out", str(workers), environment)
        driver = forked.Process(target=drive_quietly, args=given)
        driver.start()
        return driver

    return start


def ended(driver: BaseProcess, seconds: float = 120.0) -> int | None:
    """Its exit status; None if it goes on for longer."""
    driver.join(seconds)
    return driver.exitcode


def wait_for(condition, seconds: float = 120.0) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "it never came about"
        time.sleep(0.01)


def is_alive(pid: int) -> bool:
    state = Path(f"/proc/{pid}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kills", "num_runs"), [(6, 10), pytest.param(100, 150, marks=pytest.mark.slow)]
)
def test_kills_at_random_lose_and_double_nothing(beside, start_driver, kills, num_runs):
    """Of runs, of the driver, and of both at once."""
    rng, workers = random.Random(kills), min(2, cores())
    driver, done = start_driver(beside, range(num_runs), workers), 0
    while done < kills:
        before = len(begun(beside))
        wait_for(lambda n=before, d=driver: d.exitcode is not None or len(begun(beside)) > n)
        assert driver.exitcode is None, "it was done before it could be killed so often"
        time.sleep(rng.uniform(0, 0.25))
        what = rng.choice(["run", "driver", "both"])
        if what != "driver":
            pid = int(begun(beside)[-1].split()[1])
            if is_alive(pid):
                os.kill(pid, signal.SIGKILL)
                done += 1
        if what != "run":
            driver.kill()
            ended(driver)
            done += 1
            driver = start_driver(beside, range(num_runs), workers)
    assert ended(driver) == 0
    assert not lines(beside / "doubled")
    found = entries(beside / "out")
    assert len(found) == num_runs
    assert {run["status"] for run in found.values()} == {"done"}
    assert {run["scores"]["percent_error"] for run in found.values()} == {
        seed / 10 for seed in range(num_runs)
    }
    assert sum(run["failures"] for run in found.values()) == 0


@pytest.mark.thorough
def test_two_drivers_share_the_work(beside, start_driver):
    drivers = [start_driver(beside, range(8), 1) for _ in range(2)]
    assert [ended(driver, 60) for driver in drivers] == [0, 0]
    assert len(begun(beside)) == 8
    assert not lines(beside / "doubled")


@pytest.mark.thorough
def test_a_driver_does_what_no_other_does_before_it_waits(beside, start_driver):
    held = Places(beside / "out", "cartpole-tune-s0")
    held.make_folders()
    lease = Lease.take(held.lease)
    driver = start_driver(beside, range(4), 1)
    wait_for(lambda: len(begun(beside)) == 3)
    assert ended(driver, 1.0) is None
    assert sorted(line.split()[0][-2:] for line in begun(beside)) == ["s1", "s2", "s3"]
    lease.close()
    assert ended(driver, 60) == 0
    assert len(begun(beside)) == 4


@pytest.mark.thorough
def test_drivers_of_two_grids_in_one_folder_keep_each_others_entries(beside, start_driver):
    drivers = [start_driver(beside, seeds, 1) for seeds in (range(4), range(4, 8))]
    assert [ended(driver, 60) for driver in drivers] == [0, 0]
    found = entries(beside / "out")
    assert sorted(found) == [f"cartpole-tune-s{seed}" for seed in range(8)]
    assert {run["status"] for run in found.values()} == {"done"}


# --- how long it takes --------------------------------------------------------------------


def asked(seed: int, task: str = "cartpole") -> AskedRun:
    options = {"task": task, "seed": seed}
    return AskedRun(name=f"{task}-{seed}", command="tune", options=options, folder=Path())


def test_time_left_by_hand():
    assert seconds_left([10, 20, 30], 1) == 60
    assert seconds_left([10, 20, 30], 2) == 30
    assert seconds_left([10, 20, 60], 2) == 60  # the longest cannot be split
    assert seconds_left([10, -5], 1) == 10  # one takes longer than was thought
    assert seconds_left([10, None], 1) is None
    assert seconds_left([], 3) == 0


def test_finished_runs_tell_more_than_pilots_and_pilots_more_than_other_kinds(tmp_path):
    runs = [asked(0), asked(1), asked(2), asked(0, "finger"), asked(0, "walker")]
    standings = {run.name: Standing(status="waiting") for run in runs}
    pilots = Pilots(tmp_path)
    assert Expectation(runs, standings, pilots)[runs[0]] is None
    pilots.add(runs[0].kind, Pilot(100.0, "a whole run"))
    pilots.add(runs[3].kind, Pilot(50.0, "a whole run"))
    assert Expectation(runs, standings, Pilots(tmp_path))[runs[2]] == 100
    standings["cartpole-0"] = Standing(status="done", spent_s=10.0, scores={"wall_s": 8.0})
    standings["cartpole-1"] = Standing(status="done", spent_s=1.0, scores={"wall_s": 20.0})
    expected = Expectation(runs, standings, pilots)
    assert [expected[run] for run in runs[2:]] == [15, 50, 15]


def test_a_dry_run_measures_a_pilot_of_each_kind_once_and_starts_no_run(beside):
    text = GRID.replace('"cartpole"', '["cartpole", "finger"]')
    config = SweepConfig(grid=grid(beside, [0, 1], text), out=beside / "out", workers=1)
    said: list[str] = []
    left_s = dry_run(config, said.append, STAND_IN)
    assert len(begun(beside)) == 2
    assert not (beside / "out" / "runs").exists()
    pilots = json.loads((beside / "out" / "pilots.json").read_text())
    assert left_s == pytest.approx(2 * sum(pilot["wall_s"] for pilot in pilots.values()))
    assert 4 * 0.2 < left_s < 4 * 20
    assert dry_run(config, said.append, STAND_IN) == left_s
    assert len(begun(beside)) == 2
    began_s = time.monotonic()
    sweep(config, STAND_IN)
    assert time.monotonic() - began_s > 4 * 0.2
    assert dry_run(config, said.append, STAND_IN) == 0


def test_a_pilot_that_was_cut_short_says_what_its_number_rests_on(beside):
    text = GRID.replace('"cartpole"', '"cartpole"\nbudget_minutes = 5')
    config = SweepConfig(
        grid=grid(beside, [0], text),
        out=beside / "out",
        workers=1,
        dry_run=True,
        pilot_minutes=0.05 / 60,
    )
    said: list[str] = []
    assert dry_run(config, said.append, STAND_IN) == 300
    assert "by its budget, at most" in said[-2]
    assert dry_run(config, said.append, STAND_IN) == 300
    assert sum(words.startswith("pilots of 1 kinds") for words in said) == 1  # then it is known
    longer = replace(config, pilot_minutes=1)
    assert dry_run(longer, said.append, STAND_IN) < 60
    assert "by a whole run" in said[-2]


def test_a_whole_pilot_that_was_stopped_once_counts_the_time_before(beside, monkeypatch):
    monkeypatch.setenv("STAND_IN_WALL_S", "50")
    config = SweepConfig(grid=grid(beside, [0]), out=beside / "out", workers=1)
    assert dry_run(config, list[str]().append, STAND_IN) == 50


@pytest.mark.parametrize("damaged", ["{", "[]", '{"runs": [{}]}', '{"runs": 1}'])
def test_a_damaged_board_is_named(damaged, beside):
    config = SweepConfig(grid=grid(beside, [0]), out=beside / "out")
    config.out.mkdir()
    (config.out / "sweep.json").write_text(damaged)
    with pytest.raises(InputError, match="out cannot be a sweep's folder"):
        sweep(config, STAND_IN)


def test_a_runs_folder_without_a_sound_result_is_waiting(tmp_path):
    places = Places(tmp_path, "a")
    assert places.standing(0).status == "waiting"
    places.run.mkdir(parents=True)
    (places.run / "result.json").write_text('{"wall_s": 3.0}')
    assert places.standing(0).status == "waiting"  # its report comes last
    (places.run / "report.html").write_text("")
    assert places.standing(0).scores == {"wall_s": 3.0}
    (places.run / "result.json").write_text('{"wall')
    assert places.standing(0).status == "waiting"
