"""The command line: exit statuses, one line for what is wrong, and nothing half-written."""

import inspect
import itertools
import json
import logging
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from simtune import cli
from simtune.cli import commands, program
from simtune.cli.parse import parse
from simtune.cli.run_commands import _print_result
from simtune.config import TuneConfig
from simtune.config.option_checks import flag
from simtune.devices import choose_device
from simtune.errors import InputError, blame
from simtune.progress import ProgressBar
from simtune.recordings import write_dataset
from simtune.robot.signals import ToldToEnd
from simtune.run.folder import RunFolder
from simtune.tasks import TASKS, load_task
from simtune.trajectory import Trajectory

VIDEO = "videos/observation.images.camera0/chunk-000/file-000.mp4"
DATA = "data/chunk-000/file-000.parquet"


class Simtune:
    """Runs `simtune ...` in this process."""

    def __init__(self, monkeypatch, capsys, folder: Path):
        self._monkeypatch, self._capsys, self.folder = monkeypatch, capsys, folder

    def __call__(self, *arguments: object) -> tuple[int, str, str]:
        """Exit status, stdout, stderr."""
        self._monkeypatch.setattr(sys, "argv", ["simtune", *map(str, arguments)])
        status = 0
        try:
            cli.main()
        except SystemExit as exit_:
            status = exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None)
        captured = self._capsys.readouterr()
        return status, captured.out, captured.err

    def refuses(self, *arguments: object, message: str) -> None:
        """It must exit with 2, name the reason in one line, and leave the folder as it was."""
        before = sorted(self.folder.rglob("*"))
        status, out, err = self(*arguments)
        assert status == 2, err
        assert out == ""
        lines = [line for line in err.splitlines() if not is_progress(line)]
        assert len(lines) == 1, err
        assert lines[0].startswith("simtune: ")
        assert re.search(message, lines[0]), lines[0]
        assert sorted(self.folder.rglob("*")) == before


def is_progress(line: str) -> bool:
    return re.match(r" *\d+ s +\d+ %  |NO RECORDINGS ARE GIVEN", line) is not None


@pytest.fixture
def simtune(monkeypatch, capsys, tmp_path) -> Iterator[Simtune]:
    handler = signal.getsignal(signal.SIGINT)  # an interrupted command ignores the next ones
    yield Simtune(monkeypatch, capsys, tmp_path)
    signal.signal(signal.SIGINT, handler)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A dataset with cartpole's one action."""
    rng = np.random.default_rng(0)
    trajectories = [
        Trajectory(
            np.repeat(rng.integers(256, size=(26, 8, 8, 3)), 4, 1).repeat(4, 2).astype(np.uint8),
            rng.uniform(-1, 1, (25, 1)).astype(np.float32),
            0.08,
        )
        for _ in range(2)
    ]
    folder = tmp_path_factory.mktemp("recorded") / "dataset"
    write_dataset(folder, trajectories, action_names=["slide"], robot_type="arm", task="balance")
    return folder


@pytest.fixture
def dataset(recorded, tmp_path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(recorded, tmp_path / "dataset"))


# --- what is wrong ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Expected one of .*tasks.*; --help"),
        (["tnue"], "no command 'tnue' in simtune; did you mean 'tune'"),
        (
            ["check", "cartpole", "--episodes", "two"],
            "--episodes must be a whole number, got 'two'",
        ),
        (["check", "cartpole", "--real", "pseudo"], "leave out --real pseudo"),
        (["check", "cartpole", "--real", "lerobot"], "lerobot is a robot, and check moves none"),
        (["check", "cartpole", "--real", "psuedo"], "--real psuedo: no such folder or file$"),
        (
            ["tune", "cartpole", "--out", "OUT", "--real", "psuedo"],
            "no such folder or file; did you mean pseudo",
        ),
        (["check", "<mujoco>" + 300 * "\n"], "the task is XML text: give a tuning file, or a dict"),
        (["check", 300 * "a"], "no task 'a+' in simtune"),
        (["train", "cartpole", "--out", "OUT", "--device", "gpu"], "auto, cpu, cuda or cuda:N"),
        (
            ["tune", "cartpole", "--out", "OUT", "--real", "NOWHERE", "--start-factor", "3"],
            "--start-factor goes with --real pseudo only",
        ),
        (["tune", "cartpole"], "simtune tune needs --out PATH; --help"),
        (["tune", "--out", "OUT"], "simtune tune needs TASK; --help"),
        (["tune", "cartpole", "--out"], "--out needs a value; --help"),
        (["tune", "ball_in_cap", "--out", "OUT"], "no task 'ball_in_cap'.*mean 'ball_in_cup'"),
        (
            ["tune", "cartpole", "--out", "OUT", "--serch", "paper"],
            "simtune tune has no --serch; did you mean --search",
        ),
        (["tune", "cartpole", "--out=OUT", "--reel=x"], "has no --reel; did you mean --real"),
        (["tune", "cartpole", "--out", "OUT", "--real_", "x"], "has no --real-; did you mean"),
        (["evaluate", "OUT", "--zzz"], "simtune evaluate has no --zzz; --help"),
        (["tune", "cartpole", "--out", "OUT", "--search", "papre"], "papre.*posterior"),
        (["tune", "cartpole", "--out", "OUT", "--budget-minutes", "soon"], "a number, got .soon"),
        (["tune", "cartpole", "--out", "OUT", "--budget-minutes", "0"], "above 0, got 0"),
        (["tune", "cartpole", "--out", "OUT", "--budget-minutes", "nan"], "above 0, got nan"),
        (["tune", "cartpole", "--out", "OUT", "--precision", "fine"], "such as 1%, got fine"),
        (["tune", "cartpole", "--out", "OUT", "--precision", "-1%"], "a percentage.* got -1%"),
        (["tune", "cartpole", "--out", "OUT", "--precision", "100%"], "a percentage.* got 100%"),
        (["tune", "cartpole", "--out", "OUT", "--precision", "nan%"], "a percentage.* got nan%"),
        (["tune", "cartpole", "--out", "OUT", "--real-episodes", "0"], "at least 1, got 0"),
        (["tune", "cartpole", "--out", "OUT", "--real-episodes", "1.5"], "whole number, got .1.5"),
        (["tune", "cartpole", "--out", "OUT", "--seed", "-1"], "not be negative, got -1"),
        (
            ["tune", "cartpole", "--out", "OUT", "--real", "xarm"],
            "--real xarm needs --robot FILE.toml",
        ),
        (["tune", "cartpole", "--out", "OUT", "--real", "NOWHERE"], "no such folder"),
        (["tune", "cartpole", "--out", "OUT", "--actions", "a"], "--actions goes with recordings"),
        (
            ["tune", "cartpole", "--out", "OUT", "--real", "NOWHERE", "--control-hz", "0"],
            r"must lie in \[0.01, 1000\], got 0",
        ),
        (["tune", "cartpole", "--out", "OUT", "--seed", str(2**63)], "--seed must be below 2"),
        (
            ["train", "cartpole", "--out", "OUT", "--budget-minutes", "3"],
            "simtune train has no --budget-minutes; --help",
        ),
        (["tune", "my_robot", "--out", "OUT"], "tuning files end in .toml"),
        (
            ["tune", "cartpole", "--out", "OUT", "--known-colour", "grund"],
            "no colour 'grund' in the parameters; did you mean 'ground'",
        ),
        (
            ["tune", "cartpole", "--out", "OUT", "--known-colour", "ground", "--search", "paper"],
            "--known-colour goes with --search posterior, got paper",
        ),
        (
            ["record", "cartpole", "--out", "/proc/x/y"],
            "cannot write into /proc/x: .*another place",
        ),
        (["report", "NOWHERE"], "is no run: there is no such folder$"),
        (["figures", "NOWHERE"], "nowhere: no such folder or file$"),
        (["check", "cartpole", "--real", ""], "--real needs a value, got ''; --help"),
        (["tune", "cartpole", "--out="], "--out needs a value, got ''; --help"),
        (["report", ""], "simtune report needs a value, got ''; --help"),
    ],
)
def test_unusable_arguments_exit_with_2_and_one_line(simtune, tmp_path, arguments, message):
    places = {"OUT": str(tmp_path / "out"), "NOWHERE": str(tmp_path / "nowhere")}
    simtune.refuses(*(places.get(a, a) for a in arguments), message=message)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"pole_mas": 0.2}', "no parameter 'pole_mas' in cartpole; did you mean 'pole_mass'"),
        ('{"pole_mass": 1e3}', r"'pole_mass' must lie in \[0.01, 1\] kg, got 1000"),
        ('{"body_r": "red"}', "must be a finite number, got 'red'"),
        ('{"body_r": NaN}', "must be a finite number, got nan"),
        ('{"body_r": true}', "must be a finite number, got True"),
        ('{"body_r": 1' + 400 * "0" + "}", "must be a finite number, got 1000"),
        ("[0.1]", "must hold one JSON object"),
        ("pole_mass: 1", "is not JSON"),
        (b"\xff\xfe", "is not JSON"),
        (None, "no such folder or file"),
    ],
)
def test_unusable_real_parameters_are_refused(simtune, tmp_path, content, message):
    path = tmp_path / "real.json"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    arguments = ("tune", "cartpole", "--out", tmp_path / "out", "--real-parameters", path)
    simtune.refuses(*arguments, message=message)


def test_real_parameters_are_of_a_pseudo_real_world_only(simtune, tmp_path, dataset):
    path = tmp_path / "real.json"
    path.write_text("{}")
    arguments = ["tune", "cartpole", "--out", tmp_path / "out", "--real", dataset]
    simtune.refuses(*arguments, "--real-parameters", path, message="pseudo only")


def drop_column(folder: Path, name: str) -> None:
    table = pq.read_table(folder / DATA)
    pq.write_table(table.drop_columns([name]), folder / DATA)


def set_first_action(folder: Path, action: list[float]) -> None:
    rows = pq.read_table(folder / DATA).to_pylist()
    for row in rows:
        row["action"] = np.ravel(row["action"]).tolist()  # of one action, plain numbers
    rows[0]["action"] = action
    pq.write_table(pa.Table.from_pylist(rows), folder / DATA)


def truncate_video(folder: Path) -> None:
    content = (folder / VIDEO).read_bytes()
    (folder / VIDEO).write_bytes(content[: len(content) // 2])


def empty_it(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (empty_it, "is empty"),
        (truncate_video, "copy the file again|truncated|damaged"),
        (lambda folder: (folder / VIDEO).unlink(), "missing|no such"),
        (lambda folder: drop_column(folder, "action"), "no column 'action'"),
        (lambda folder: set_first_action(folder, [float("nan")]), "action is not finite"),
        (lambda folder: set_first_action(folder, [0.1, 0.2]), "expected 1 actions.*got 2"),
    ],
)
def test_unsound_recordings_are_refused_in_one_line(simtune, tmp_path, dataset, spoil, message):
    spoil(dataset)
    arguments = ("tune", "cartpole", "--out", tmp_path / "out", "--real", dataset)
    simtune.refuses(*arguments, "--real-episodes", 2, message=message)


def test_train_refuses_unsound_recordings_before_it_writes_anything(simtune, tmp_path, dataset):
    truncate_video(dataset)
    arguments = ("train", "cartpole", "--out", tmp_path / "out", "--real", dataset)
    simtune.refuses(*arguments, "--real-episodes", 2, message="copy the file again")


def test_chosen_actions(simtune, tmp_path, dataset):
    arguments = ("tune", "cartpole", "--out", tmp_path / "out", "--real", dataset)
    message = f"no action 'slider' in {dataset}; did you mean 'slide'?"
    simtune.refuses(*arguments, "--actions", "slider", message=message)
    message = "action 'slide' is asked for twice; name it once"
    simtune.refuses(*arguments, "--actions", "slide,slide", message=message)


def test_recordings_of_other_actions_or_too_few_episodes_are_refused(simtune, tmp_path, dataset):
    arguments = ("--out", tmp_path / "out", "--real", dataset)
    message = "takes 2 actions, the recording has 1"
    simtune.refuses("tune", "ball_in_cup", *arguments, message=message)
    message = "5 episodes asked for, it holds 2"
    simtune.refuses("tune", "cartpole", *arguments, "--real-episodes", 5, message=message)


def test_a_camera_is_one_of_the_recordings(simtune, tmp_path, dataset):
    arguments = ("--out", tmp_path / "out", "--camera", "front")
    simtune.refuses("tune", "cartpole", *arguments, "--real", dataset, message="no camera 'front'")
    simtune.refuses("tune", "cartpole", *arguments, message="--camera goes with recordings only")


@pytest.mark.thorough
def test_episodes_too_short_leave_no_folder(simtune, tmp_path, one_renderer_each):
    frames = np.zeros((6, 32, 32, 3), np.uint8)
    trajectory = Trajectory(frames, np.zeros((5, 1), np.float32), 0.08)
    write_dataset(
        tmp_path / "short", [trajectory], action_names=["slide"], robot_type="arm", task="balance"
    )
    arguments = ["--out", tmp_path / "out", "--real", tmp_path / "short", "--real-episodes", 1]
    simtune.refuses(
        "tune",
        "cartpole",
        *arguments,
        message="episode 0 has 5 steps; expected at least 21: leave it out",
    )


@pytest.mark.thorough
def test_an_out_that_cannot_be_used_is_refused(simtune, tmp_path, quick_commands):
    (tmp_path / "file").write_text("x")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("x")
    for out, message in (
        (tmp_path / "file", "is a file"),
        (tmp_path / "file" / "run", "Not a directory"),
        (tmp_path / "full", "is not empty and no run"),
        ("/proc/run", "cannot write the run folder"),
    ):
        few = ("--real-episodes", 1, "--image-size", 32)
        simtune.refuses("tune", "cartpole", "--out", out, *few, message=message)


def test_what_a_library_warns_of_is_printed_once(capsys):
    tell = program._TellOnce()
    for message in ("attribute 'x' is\n deprecated", "another", "attribute 'x' is deprecated"):
        tell(UserWarning(message), UserWarning, "model.py", 11)
    printed = capsys.readouterr()
    assert printed.err == "warning: attribute 'x' is deprecated\nwarning: another\n"
    assert printed.out == ""


@pytest.mark.parametrize(
    "module", ["api", "report", "export", "sweep", "compare", "figures", "experiment.finished"]
)
def test_commands_that_learn_nothing_load_no_torch(module):
    """It takes seconds."""
    code = f"import sys, simtune.{module}; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout == "False\n", done.stderr


def test_what_a_tuning_file_has_wrong_is_said_before_torch_is_loaded(tmp_path):
    (tmp_path / "wrong.toml").write_text("model = 3")
    code = """if True:
    import sys
    from simtune.cli import main
    for command in ("check", "tune", "train", "record"):
        out = [] if command == "check" else ["--out", "run"]
        sys.argv = ["simtune", command, "wrong.toml", *out]
        try:
            main()
        except SystemExit as end:
            print(command, end.code, "torch" in sys.modules)
    """
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    said = "simtune: wrong.toml:1: model must be a text, got 3"
    assert done.stderr.splitlines() == [said] * 4
    assert done.stdout.splitlines() == [
        f"{command} 2 False" for command in ("check", "tune", "train", "record")
    ]


def test_what_reads_finished_runs_does_not_load_torch():
    code = "import simtune.report.page, simtune.compare, sys; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "False\n", done.stderr


def test_to_compare_runs_loads_nothing_that_draws_or_simulates():
    code = (
        "import simtune.compare, sys\n"
        "print([m for m in ('matplotlib', 'jinja2', 'mujoco', 'av', 'torch') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "[]\n", done.stderr


# --- what fails ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (RuntimeError("all worlds\ndiverged"), "all worlds diverged"),
        (OSError(28, "No space left on device"), "No space left on device"),
    ],
)
def test_failures_exit_with_1_and_one_line(simtune, tmp_path, monkeypatch, error, words):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("simtune.tuning_run.tune", fail)
    status, out, err = simtune("tune", "cartpole", "--real", "pseudo", "--out", tmp_path / "out")
    assert (status, out) == (1, "")
    assert err.startswith("simtune: ")
    assert err.count("\n") == 1
    assert words in err


def test_the_time_to_load_torch_is_part_of_the_budget(simtune, tmp_path, monkeypatch):
    def begin(*_, loading_s: float, **__):
        raise RuntimeError(f"{loading_s} s are spent")

    monkeypatch.setattr("simtune.tuning_run.tune", begin)
    monkeypatch.setattr("time.monotonic", itertools.count(0, 7).__next__)  # 7 s from look to look
    _, _, err = simtune("tune", "cartpole", "--real", "pseudo", "--out", tmp_path / "out")
    spent_s = int(re.search(r"(\d+) s are spent", err)[1])
    assert spent_s > 0
    assert spent_s % 7 == 0


def test_ctrl_c_while_torch_is_loaded_is_one_line_as_well(tmp_path):
    """Python forgets what was loaded by half; to load it again may crash."""
    stop = (
        "import sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'torch': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        f"sys.argv = ['simtune', 'tune', 'cartpole', '--out', {str(tmp_path / 'run')!r}]\n"
        "from simtune.cli import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", stop], capture_output=True, text=True)
    assert done.returncode == 130
    *_, last = done.stderr.splitlines()
    assert last == "simtune: interrupted before it began: nothing is lost"
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("command", "rounds", "words"),
    [
        (
            "tune",
            0,
            "before there was anything to keep: its 0 s are lost, and the same command",
        ),
        ("tune", 1, "kept: 1 finished round; lost: the round in progress, 0 s; the same command"),
        ("train", 2, "and 50 steps of the policy's training; lost: the last 0 s; the same"),
        ("record", 0, "interrupted"),
    ],
)
def test_an_interrupted_command_exits_with_130_and_says_what_is_kept(
    simtune, tmp_path, monkeypatch, command, rounds, words
):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    out = tmp_path / "out"
    if rounds:
        with RunFolder.create(out, {}) as run:
            run.save_checkpoint({}, {"step": 50, "rounds": rounds})
    for name in ("tuning_run.tune", "algorithm.train", "filming.record"):
        monkeypatch.setattr(f"simtune.{name}", interrupt)
    status, said, err = simtune(command, "cartpole", "--out", out)
    lines = [line for line in err.splitlines() if not is_progress(line)]
    assert (status, said, len(lines)) == (130, "", 1)
    assert words in err
    assert ("it ends with what there is" in err) == (command == "tune" and rounds > 0)


def test_a_second_ctrl_c_is_not_heard_while_the_first_is_answered(simtune, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    def answer(*_):
        signal.raise_signal(signal.SIGINT)
        return "interrupted"

    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr("simtune.tuning_run.tune", interrupt)
    monkeypatch.setattr("simtune.cli.program._interrupted", answer)
    status, _, err = simtune("tune", "cartpole", "--out", tmp_path / "out")
    assert (status, err.splitlines()[-1]) == (130, "simtune: interrupted")


def test_of_a_round_that_was_cut_off_the_detector_is_kept(simtune, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with RunFolder.create(tmp_path / "out", {}) as run:
        run.save_checkpoint({}, {"step": 50, "rounds": 0, "is_within": True})
    monkeypatch.setattr("simtune.tuning_run.tune", interrupt)
    _, _, err = simtune("tune", "cartpole", "--out", tmp_path / "out")
    assert "kept: 0 finished rounds and the next one's detector; lost: what came after" in err
    assert "it ends with what there is" not in err


def test_what_is_lost_began_with_the_newest_checkpoint_or_the_command(
    simtune, tmp_path, monkeypatch
):
    out = tmp_path / "out"
    with RunFolder.create(out, {}) as run:
        run.save_checkpoint({}, {"step": 50, "rounds": 1})
    (saved,) = (out / "checkpoints").iterdir()
    now_s = time.time()

    def lost(saved_s: float, began_s: float) -> str:
        def interrupt(*_, **__):
            raise KeyboardInterrupt

        monkeypatch.setattr("simtune.tuning_run.tune", interrupt)
        os.utime(saved, (now_s - saved_s,) * 2)
        times = iter([now_s - began_s, now_s])
        clock = SimpleNamespace(time=lambda: next(times))
        monkeypatch.setattr("simtune.cli.program.time", clock)
        return re.search(r"in progress, ([^;]+);", simtune("tune", "cartpole", "--out", out)[2])[1]

    assert lost(saved_s=75, began_s=300) == "1 min 15 s"
    assert lost(saved_s=900, began_s=40) == "40 s"


def test_a_name_that_is_nearly_there_is_suggested_at_once(tmp_path):
    """Before torch is loaded, whatever the command."""
    (tmp_path / "pendulum_run").mkdir()
    (tmp_path / "pendulum.toml").touch()
    commands = (
        ["report", "pendulum_rum"],
        ["export", "pendulum_rum", "--out", "x"],
        ["compare", "pendulum_run", "pendulum_rum"],
        ["evaluate", "pendulum_rum"],
        ["check", "cartpole", "--real", "pendulum_rum"],
        ["tune", "cartpole", "--real", "pendulum_rum", "--out", "x"],
        ["check", "pendulun.toml"],
    )
    code = f"""if True:
    import sys
    from simtune.cli import main
    for arguments in {commands}:
        sys.argv = ["simtune", *arguments]
        try:
            main()
        except SystemExit as end:
            print(end.code, {{"torch", "mujoco"}} & sys.modules.keys())
    """
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.stdout.splitlines() == ["2 set()"] * len(commands)
    said = done.stderr.splitlines()
    assert len(said) == len(commands)
    for line in said:
        assert line.startswith(("simtune: pendul", "simtune: --real pendulum_rum: no"))
        assert line.endswith(("mean pendulum_run?", "mean pendulum.toml?"))


# --- what works ---------------------------------------------------------------------------


def test_tasks_lists_tasks_and_with_a_name_every_parameter(simtune):
    status, out, err = simtune("tasks")
    assert (status, err) == (0, "")
    *lines, empty, hint = out.splitlines()
    listed = {line.split()[0]: line for line in lines}
    assert list(listed) == list(TASKS)
    assert listed["cartpole"].endswith("keep the pole on the cart upright (8 parameters)")
    assert (empty, hint) == ("", "simtune tasks NAME lists a task's parameters")
    for task in TASKS:
        status, out, _ = simtune("tasks", task)
        head, _, columns, *rows = out.splitlines()
        assert head.startswith(f"{task}: ")
        assert columns.split()[:4] == ["parameter", "nominal", "low", "high"]
        named = [row.split()[0] for row in rows if row and "--observe" not in row]
        assert tuple(named) == tuple(load_task(task).parameters.names)
    line = "actuator_gain        1   0.1    10        actuator_gainprm of slide"
    assert line in simtune("tasks", "cartpole")[1]
    assert list(json.loads(simtune("tasks", "walker", "--json")[1])) == ["walker"]
    simtune.refuses("tasks", "ball_in_cap", message="did you mean 'ball_in_cup'")


@pytest.mark.thorough
def test_tune_and_report_write_a_report(simtune, tmp_path, quick_commands, monkeypatch):
    out = tmp_path / "run"
    few = ("--real-episodes", 1, "--image-size", 32, "--budget-minutes", "1e-5")
    command = ("tune", "cartpole", "--out", out, *few)
    status, said, progress = simtune(*command)
    assert status == 0
    assert all(is_progress(line) for line in progress.splitlines())  # no terminal: plain lines
    assert progress.startswith("NO RECORDINGS ARE GIVEN, so this tunes to a simulated truth: --re")
    assert "looking at the real world" in progress
    assert "round 1: simulating" in progress
    assert "100 %" in progress
    assert "pole_mass" in said
    assert "mean error" in said
    assert str(out / "report.html") in said
    result = json.loads((out / "result.json").read_text())
    assert result["command"] == shlex.join(map(str, ("simtune", *command)))
    written = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    _, again, progress = simtune(*command, "--real", "pseudo")
    over = f"{out} is finished: the time is over, or too short for another round; with more --budge"
    assert over in progress
    assert "filming" not in progress
    assert again.splitlines() == said.splitlines()
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == written
    (out / "report.html").unlink()
    assert "NO RECORDINGS" not in simtune(*command, "--real", "pseudo")[2]
    assert json.loads(simtune(*command, "--json")[1]) == json.loads(
        (out / "result.json").read_text()
    ) | {"report": str(out / "report.html")}
    (out / "report.html").unlink()
    status, said, err = simtune("report", out)
    assert (status, said, err) == (0, f"{out / 'report.html'}\n", "")
    assert json.loads(simtune("report", out, "--json")[1]) == {"report": f"{out / 'report.html'}"}
    exported = json.loads(simtune("export", out, "--out", tmp_path / "tuned", "--json")[1])
    files = sorted(str(path) for path in (tmp_path / "tuned").rglob("*") if path.is_file())
    assert exported == {"files": files}
    assert (out / "report.html").is_file()
    shown = []
    monkeypatch.setattr("webbrowser.open", shown.append)
    assert simtune("report", out, "--open")[0] == 0
    assert shown == [(out / "report.html").as_uri()]
    simtune.refuses(*command, "--seed", 9, message="--seed 0, now 9")


@pytest.mark.thorough
def test_two_runs_are_compared_and_draws_of_one_are_taken_along(simtune, tmp_path, quick_commands):
    runs = [tmp_path / "one", tmp_path / "other"]
    for seed, out in enumerate(runs):
        few = ("--real-episodes", 1, "--image-size", 32, "--budget-minutes", "1e-5")
        assert simtune("tune", "cartpole", "--out", out, *few, "--seed", seed)[0] == 0
    status, said, err = simtune("compare", *runs)
    assert (status, err) == (0, "")
    assert said.splitlines()[0] == f"cartpole: run 1 {runs[0]}, run 2 {runs[1]}"
    assert "agree: the largest of 8 differences is" in said.splitlines()[-1]
    told = json.loads(simtune("compare", *runs, "--json")[1])
    z = {name: entry["difference_std"] for name, entry in told["parameters"].items()}
    assert max(map(abs, z.values())) == abs(z[told["largest"]])
    assert f"({told['largest']})" in said
    assert told["agree"] == (abs(z[told["largest"]]) <= told["limit_std"])
    status, said, _ = simtune("export", runs[0], "--out", tmp_path / "w.csv", "--samples", 20)
    assert (status, said) == (0, f"{tmp_path / 'w.csv'}\n")
    header, *rows = (tmp_path / "w.csv").read_text().splitlines()
    with np.load(runs[0] / "posterior.npz") as file:
        assert header.split(",") == file["names"].tolist()
        samples = np.array([row.split(",") for row in rows], float)
        np.testing.assert_allclose(samples, file["draws"][:20], rtol=1e-9)
    simtune.refuses("compare", runs[0], tmp_path / "none", message="there is no such folder")


@pytest.mark.thorough
def test_a_training_that_searches_for_nothing_prints_its_warnings_alone(
    simtune, tmp_path, quick_commands
):
    """One round of random actions: nothing was learnt."""
    rest = ("--policy-steps", 96, "--scored-episodes", 1, "--out", tmp_path / "run")
    status, said, _ = simtune("train", "cartpole", "--method", "dr", *rest)
    assert status == 0
    assert not (tmp_path / "run" / "posterior.npz").exists()
    assert "pole_mass" not in said
    assert "warning: the policy had not begun to learn: give more --policy-steps" in said
    assert "in 1 episode\n" in said
    simtune.refuses("evaluate", tmp_path / "run", message="no policy yet: its training is fin")
    simtune.refuses("compare", *[tmp_path / "run"] * 2, message="dr, which gives no intervals")


def test_of_a_training_on_recordings_it_is_said_how_to_score_the_policy(tmp_path):
    result, said = {"method": "dr", "warnings": [], "policy_steps": 9}, list[str]()
    _print_result(result, tmp_path / "a b", said.append)
    found = tmp_path / "a b"
    command = f"simtune evaluate '{found}' --parameters '{found / 'result.json'}'"
    assert said[0].endswith(command)
    said.clear()
    _print_result(result | {"return": {"mean": 1.0, "std": 0.0, "episodes": 2}}, found, said.append)
    assert said[0] == "return 1.00 ± 0 in 2 episodes"


def test_report_on_a_run_that_has_just_begun(simtune, tmp_path):
    RunFolder.create(tmp_path / "run", {"task": "cartpole"}).close()
    status, _, _ = simtune("report", tmp_path / "run")
    assert status == 0


def in_a_shell(command: str) -> subprocess.CompletedProcess:
    code = "from simtune.cli import main; main()"
    line = command.replace("simtune", f"{sys.executable} -c '{code}'", 1)
    return subprocess.run(["bash", "-o", "pipefail", "-c", line], capture_output=True, text=True)


def test_tasks_and_recordings_in_json(simtune, tmp_path):
    tasks = json.loads(simtune("tasks", "--json")[1])
    assert tasks.keys() == TASKS.keys()
    assert tasks["cartpole"]["parameters"]["pole_mass"]["unit"] == "kg"
    out = tmp_path / "films"
    short = ("--episodes", 1, "--image-size", 16, "--json")
    said = simtune("record", "cartpole", "--out", out, *short)[1]
    assert json.loads(said) == {"recordings": str(out), "episodes": 1}


@pytest.mark.parametrize(
    "name", ["cart_pendulum", "phone_pendulum", "bouncing_ball", "servos", "unitree_g1", "aloha"]
)
def test_every_example_can_be_copied_once(simtune, tmp_path, name):
    """What the help names is what there is."""
    assert name in inspect.getsource(commands)
    status, said, _ = simtune("example", name, "--out", tmp_path / "new")
    assert status == 0
    root, made = Path(__file__).parents[2] / "examples" / name, tmp_path / "new" / name
    first = f"{made / 'prepare.sh'}, then " if (root / "prepare.sh").exists() else ""
    assert f"{made}; next: {first}simtune check {made / 'tune.toml'}" in said
    for path in (p for p in root.iterdir() if p.is_file() and not p.name.startswith(".")):
        assert (tmp_path / "new" / name / path.name).read_bytes() == path.read_bytes()
    assert not (tmp_path / "new" / name / "model").exists()
    simtune.refuses("example", name, "--out", tmp_path / "new", message="is there already: give")


def test_an_example_that_is_not_there(simtune):
    says = "no example 'pendulum' in simtune.*(mean|are).*cart_pendulum"
    simtune.refuses("example", "pendulum", message=says)


def test_a_doctor_says_the_same_in_lines_and_in_json_and_fails_after_it(simtune, monkeypatch):
    found = [("python", "3.11"), ("raycaster", "works: 9 frames/s at 64 px"), ("opengl", "no")]
    monkeypatch.setattr("simtune.doctor.analyze", lambda: iter(found))
    status, said, _ = simtune("doctor")
    assert (status, said.splitlines()[1]) == (0, "raycaster        works: 9 frames/s at 64 px")
    assert json.loads(simtune("doctor", "--json")[1]) == dict(found)
    found[1] = ("raycaster", "does not work: no driver")
    status, said, err = simtune("doctor", "--json")
    assert (status, json.loads(said)) == (1, dict(found))
    assert err.startswith("simtune: the default renderer does not work here")


def test_a_closed_pipe_causes_no_traceback():
    done = in_a_shell("simtune tasks | head -1")
    assert done.stdout.startswith("ball_in_cup")
    assert done.stderr == ""


def test_what_stdout_cannot_encode_is_a_question_mark():
    done = in_a_shell("PYTHONIOENCODING=ascii simtune tasks walker")
    assert (done.returncode, done.stderr) == (0, "")
    assert "?" in done.stdout


def test_a_closed_stdout_causes_no_traceback():
    done = in_a_shell("simtune tasks >&-")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("command", ["", "tune", "tasks", "report", "doctor"])
def test_help_prints_the_usage_and_the_options_of_tune(simtune, command):
    status, out, err = simtune(*command.split(), "--help")
    assert (status, err) == (0, "")
    assert "usage: simtune" in out
    if command == "tune":
        for option in ("--real", "--real-parameters", "--real-episodes", "--search", "--seed"):
            assert option in out
        assert "minutes" in out


def test_help_lists_a_commands_own_options_first_in_whole_sentences(simtune, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    _, out, _ = simtune("tune", "--help")
    shown = re.findall(r"^[│ ] {1,2}(--[a-z-]+)", out, re.MULTILINE)
    assert shown[:3] == ["--out", "--real", "--real-episodes"]
    assert re.findall(r"(\S+) options", out) == ["recordings", "robot", "pseudo-real"]
    assert "--no-" not in out
    assert set(shown) == {flag(field.name) for field in fields(TuneConfig)} - {"--task"}
    assert "(default: None)" not in out
    assert "(default: 8.0)" in out
    assert "(by default all, at most 10)" in out  # the docstring breaks the line in there


def test_help_of_all_shows_what_to_type_first(simtune):
    _, out, _ = simtune("--help")
    typed = re.findall(r"^  simtune (.*)", out, re.MULTILINE)
    assert [line.split()[0] for line in typed] == ["check", "tune", "export"]
    for line in typed:
        parse(line.split())
    assert "--version" in out
    assert "--tyro-print-completion bash" in out
    assert "Takes seconds, plus the time to read recordings" not in out  # the second sentence


def test_help_says_of_each_command_how_large_its_pictures_are(simtune, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    of_check, of_tune = (simtune(command, "--help")[1] for command in ("check", "tune"))
    assert "and 240 with --camera-pose" in of_check
    assert "paper's search" not in of_check
    assert "100 for the paper's search" in of_tune


def test_flags_are_shown_once_and_what_sweeps_type_is_understood(simtune):
    assert "(default: )" not in (out := simtune("compare", "--help")[1])
    assert "(required)" in out
    assert re.search(r"^. --json  +Print", out, re.MULTILINE)
    assert parse(["tune", "cartpole", "--out", "x", "--no-move", "--json"]).move is False


def test_an_order_to_end_is_not_blamed_on_a_users_code():
    with pytest.raises(ToldToEnd), blame("the code failed"):
        raise ToldToEnd(signal.SIGTERM)


def test_a_folder_in_place_of_its_tuning_file_is_told(simtune, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "tune.toml").touch()
    status, _, said = simtune("check", str(tmp_path / "mine"))
    assert status == 2
    assert said.strip().endswith(f"give its tuning file, {tmp_path / 'mine' / 'tune.toml'}")


# Each prints what is offered for the words after `simtune`, a line each; {script} is its own.
_OFFERS = {
    "bash": """
        source {script}
        COMP_WORDS=(simtune "$@"); COMP_CWORD=$#; _tyro_simtune
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """,
    "zsh": """
        _files() {{ print -rl -- "$words[CURRENT]"*; }}
        _describe() {{ print -rl -- "${{completion_array[@]%%:*}}"; }}
        words=(simtune "$@"); CURRENT=$#words
        source {script}
    """,
    "fish": """
        source {script}
        complete -C "simtune $argv" | string replace -r "\\t.*" ""
    """,
}


@pytest.mark.parametrize("shell", _OFFERS)
def test_shells_complete_commands_options_and_files(simtune, shell, tmp_path):
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    status, script, _ = simtune("--tyro-print-completion", shell)
    assert status == 0
    (tmp_path / "script").write_text(script)
    (tmp_path / "ask").write_text(_OFFERS[shell].format(script=tmp_path / "script"))
    (tmp_path / "mine.toml").touch()
    (tmp_path / "mine two").mkdir()  # a space in it

    def offered(*words: str) -> list[str]:
        done = subprocess.run(
            [shell, str(tmp_path / "ask"), *words],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=tmp_path,
        )
        lines = [line.strip().rstrip("/").replace("\\ ", " ") for line in done.stdout.splitlines()]
        return sorted(line for line in lines if line)

    options = offered("tune", "mine.toml", "--re")
    assert options == ["--real", "--real-episodes", "--real-gap", "--real-parameters"]
    assert offered("tu") == ["tune"]
    assert offered("tune", "mi") == ["mine two", "mine.toml"]
    assert offered("tune", "mine.toml", "--real", "mi") == ["mine two", "mine.toml"]


def test_help_loads_no_heavy_packages():
    code = (
        "import sys; sys.argv = ['simtune', 'tune', '--help']\n"
        "from simtune.cli import main\n"
        "try:\n    main()\n"
        "except SystemExit:\n    pass\n"
        "print('loaded', [m for m in ('torch', 'mujoco', 'warp', 'av') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.endswith("loaded []\n")


# --- progress -----------------------------------------------------------------------------


def test_progress_prints_a_line_when_something_new_begins(capsys):
    with ProgressBar(1e9) as progress:
        for done in (0.0, 0.1, 0.2):
            progress("learning", done)
        progress("filming", 0.9)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split("%")[1].strip() for line in lines] == ["learning", "filming"]
    assert all(is_progress(line) for line in lines)


def test_what_is_logged_meanwhile_is_a_line_of_its_own(capsys):
    log = logging.getLogger("simtune.somewhere")
    log.info("before")
    with ProgressBar(1e9) as progress:
        progress("learning", 0.0)
        log.info("a first answer")
    log.info("afterwards")
    assert capsys.readouterr().err.splitlines()[1:] == ["a first answer"]


def test_a_bar_begins_again_with_what_comes_next(capsys, monkeypatch):
    """A training after a search, whose share would otherwise hide it for minutes."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with ProgressBar(1e9) as progress:
        progress("fitting", 0.41)
        capsys.readouterr()
        progress("training the policy", 0.0)
        assert re.search(r"  0 %\|.*training the policy", capsys.readouterr().err)


def test_progress_never_exceeds_100_percent(capsys):
    with ProgressBar(1e-9) as progress:
        progress("too late", 0.1)
        progress("done", 1.0)
    first, last = capsys.readouterr().err.splitlines()
    assert " 99 %  too late (time is over; what has begun ends first)" in first
    assert "100 %" in last


@pytest.mark.parametrize("name", ["cpu:0", "gpu", "cuda:x", "CUDA"])
def test_a_device_of_another_name_is_refused(name):
    with pytest.raises(InputError, match="must be auto, cpu, cuda or cuda:N"):
        choose_device(name)


def test_a_gpu_that_warp_cannot_draw_on_is_not_chosen(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)  # as on a GPU of another kind
    monkeypatch.setattr("simtune.devices._can_draw", lambda device: False)
    assert choose_device("auto") == "cpu"


def test_the_command_that_comes_next_can_be_pasted_whatever_a_folder_is_called(
    simtune, tmp_path, monkeypatch
):
    folder = tmp_path / "a b"
    monkeypatch.setattr("simtune.filming.record", lambda config, _: config.out)
    _, said, _ = simtune("record", "cartpole", "--out", folder)
    typed = shlex.split(said.partition("next: ")[2])
    assert typed == ["simtune", "check", "cartpole", "--real", str(folder)]
    _, said, _ = simtune("example", "servos", "--out", folder)
    assert shlex.split(said.partition("next: ")[2])[-1] == str(folder / "servos" / "tune.toml")


def test_a_tilde_is_the_home_folder_wherever_an_option_has_it(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    for typed in (["--out=~/run", "--real=~/a~b"], ["--out", "~/run", "--real", "~/a~b"]):
        config = parse(["tune", "~/tune.toml", *typed])
        assert config.task == str(tmp_path / "tune.toml")
        assert config.out == tmp_path / "run"
        assert config.real == str(tmp_path / "a~b")
    assert parse(["tune", "cartpole", "--out=a~b"]).out == Path("a~b")


def test_scores_of_small_rewards_keep_their_digits(tmp_path):
    from simtune.cli.run_commands import _print_result

    said: list[str] = []
    result = {"method": "dr", "warnings": [], "return": {"mean": 0.42, "std": 0.31, "episodes": 10}}
    _print_result(result, tmp_path, said.append)
    assert said[0] == "return 0.420 ± 0.310 in 10 episodes"


def test_the_terminal_says_how_many_intervals_hold_the_truth(tmp_path):
    from simtune.cli.run_commands import _print_result

    def told(search: str) -> str:
        said: list[str] = []
        entry = {"initial": 2.0, "mean": 1.2, "real": 1.0, "percent_error": 20.0}
        ends = {"missed": {"low": 1.1, "high": 1.3}, "held": {"low": 0.9, "high": 1.3}}
        found = {name: entry | pair | {"verdict": "weak"} for name, pair in ends.items()}
        result = {"method": "autotune", "search": search, "parameters": found, "warnings": []}
        # Off by far, and by itself alone: no picture was used, and it shows in these only
        found["colour"] = entry | ends["missed"] | {"percent_error": 90.0, "verdict": "weak"}
        check = {name: {"std": 0.1} for name in ends} | {"colour": {}}
        result |= {"percent_error": 43.3, "check": check, "recordings": {"cameras": []}}
        (tmp_path / "config.json").write_text("{}")
        (tmp_path / "result.json").write_text(json.dumps(result))
        _print_result(result, tmp_path, said.append)
        return "\n".join(said)

    assert "mean error 20.0 %\n1 of 2 intervals hold the truth" in told("posterior")
    assert "hold the truth" not in told("paper")
    assert "no intervals by this search" in told("paper")
