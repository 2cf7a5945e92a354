"""The real world as a robot: what it films, what it keeps, and what it refuses."""

import fcntl
import json
import os
import re
import shutil
import signal
import sys
import threading
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import fake_lerobot
import numpy as np
import pytest
from servo import cartpole_with_servo

from simtune import cli
from simtune.cameras.lens import Lens
from simtune.config import RealConfig, TrainConfig, TuneConfig
from simtune.errors import InputError, RobotError
from simtune.experiment import training_experiment
from simtune.experiment.presets import choose_schedule, choose_search
from simtune.experiment.training_parts import check_filmed
from simtune.networks.cuda_graph import CALLS_BEFORE_REPLAY
from simtune.real import robot
from simtune.real.choose import choose_real
from simtune.real.recorded import RecordedReal
from simtune.real.robot import RobotReal
from simtune.recordings import open_dataset
from simtune.robot.lerobot import LeRobot, make_lerobot
from simtune.robot.robot_file import read_robot
from simtune.run import checkpoint
from simtune.run.files import read_json, write_json
from simtune.simulation import DirectActions, JointActions
from simtune.tasks import TASKS, Task, load_task
from simtune.tuning_run import tune

STEPS = 4
# 0.1 s a step, and actions that displace, as a robot's do
TASK = replace(
    load_task("cartpole"),
    load_spec=cartpole_with_servo,
    action_repeat=10,
    episode_steps=STEPS,
    map_actions=JointActions,
)
LEROBOT = """
address = "fake_lerobot:make"
speed = 100
tolerance = 3
ask = false

[actions]
moved = "-pan.pos"
step = 4

[workspace]
"pan.pos" = [-20, 20]
"lift.pos" = [0, 40]

[start]
"pan.pos" = 1
"lift.pos" = 25

[camera]
recorded_px = 32
"""


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(LEROBOT)
    return path


def make_real(file: Path, task: Task = TASK, **changes) -> RobotReal:
    settings = {"image_size": 16, "seed": 0, "folder": file.parent / "filmed", "move": True}
    return RobotReal(read_robot(file, "lerobot"), task, **settings | changes)


def lines(file: Path, sitting: int = 0) -> list[dict]:
    text = (file.parent / "filmed" / f"{sitting:03d}.jsonl").read_text()
    return [json.loads(line) for line in text.splitlines()]


def test_episodes_are_what_was_sent_and_what_was_seen(file):
    trajectories = make_real(file).collect(2)
    robot = fake_lerobot.latest[-1]
    assert not robot.is_connected
    assert [t.frames.shape for t in trajectories] == [(STEPS + 1, 16, 16, 3)] * 2
    assert trajectories[0].step_s == pytest.approx(0.1)
    noted = lines(file)
    assert [n["step"] for n in noted] == 2 * list(range(STEPS + 1))
    assert [n["episode"] for n in noted] == [0] * (STEPS + 1) + [1] * (STEPS + 1)
    steps = [n for n in noted if "sent" in n]
    actions = np.concatenate([t.actions for t in trajectories])
    for action, step in zip(actions, steps, strict=True):
        # Of an action of 1 the axis goes back by 4.
        moved = step["sent"][0] - step["measured"][0]
        assert action == pytest.approx(-moved / 4, abs=1e-6)
        assert action == pytest.approx(step["asked"], abs=1e-3)
        assert step["sent"][1] == 25.0
    # Pictures are of before the action: 128 + place.
    shades = trajectories[1].frames[:-1].mean((1, 2, 3))
    places = [step["measured"][0] for step in steps[STEPS:]]
    np.testing.assert_allclose(shades, 128 + np.array(places), atol=2)
    times_s = np.array([step["sent_s"] for step in steps]).reshape(2, STEPS)
    np.testing.assert_allclose(np.diff(times_s), 0.1, atol=0.05)


def test_what_was_filmed_is_looked_at_again(file):
    first = make_real(file).collect(2)
    made = len(fake_lerobot.latest)
    again = make_real(file, move=False).collect(2)
    assert len(fake_lerobot.latest) == made  # nothing was connected to
    recorded = RecordedReal(
        open_dataset(file.parent / "filmed" / "000", image_size=16, num_actions=1)
    ).collect()
    for a, b, c in zip(first, again, recorded, strict=True):
        np.testing.assert_array_equal(a.frames, b.frames)
        np.testing.assert_array_equal(a.frames, c.frames)
        np.testing.assert_array_equal(a.actions, c.actions)
    more = make_real(file).collect(3)
    assert len(more) == 3
    np.testing.assert_array_equal(more[1].actions, first[1].actions)
    assert not np.array_equal(more[2].actions, first[0].actions)


@pytest.fixture(scope="module")
def one_episode(tmp_path_factory) -> Path:
    """The folder of a session that filmed one."""
    file = tmp_path_factory.mktemp("session") / "arm.toml"
    file.write_text(LEROBOT)
    make_real(file).collect(1)
    return file.parent / "filmed"


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('moved = "-pan.pos"', 'moved = "pan.pos"', "actions.moved"),
        ("step = 4", "step = 1", "actions.step"),
        ('"pan.pos" = 1', '"pan.pos" = 2', "start"),
        ("[camera]", '[camera]\nname = "front"', "camera"),
    ],
)
def test_episodes_of_another_robot_file_are_not_used_together(one_episode, file, old, new, what):
    file.write_text(LEROBOT.replace(old, new))
    made, folder = len(fake_lerobot.latest), shutil.copytree(one_episode, file.parent / "filmed")
    with pytest.raises(InputError) as error:
        make_real(file).collect(2)
    assert f"{folder}/000 was filmed with another {what}, so" in str(error.value)
    assert "give another --out to film anew" in str(error.value)
    assert len(fake_lerobot.latest) == made  # nothing was connected to


def test_episodes_of_sessions_that_differ_in_nothing_else_are_used_together(one_episode, file):
    folder = shutil.copytree(one_episode, file.parent / "filmed")
    file.write_text(LEROBOT.replace("speed = 100", "speed = 90"))  # means nothing to them
    assert len(make_real(file).collect(2)) == 2
    (folder / "001.json").unlink()
    with pytest.raises(InputError, match=r"001\.json is missing or damaged"):
        make_real(file)
    write_json(folder / "001.json", read_json(folder / "000.json") | {"later": 1})
    with pytest.raises(InputError, match=r"001 was filmed with another later, so"):
        make_real(file)


@pytest.mark.parametrize(
    ("change", "what"),
    [({"action_repeat": 20}, "control_timestep_s"), ({"declared": "x"}, "content of the task")],
)
def test_episodes_of_another_tuning_file_are_not_used_together(one_episode, file, change, what):
    shutil.copytree(one_episode, file.parent / "filmed")
    with pytest.raises(InputError, match=f"000 was filmed with another {what}, so"):
        make_real(file, replace(TASK, **change))


def test_that_episodes_of_earlier_sessions_are_used_is_said(file, caplog):
    with caplog.at_level("INFO", "simtune"):
        make_real(file).collect(1)
        assert "earlier sessions" not in caplog.text
        make_real(file).collect(2)
    assert f"1 episodes of earlier sessions in {file.parent / 'filmed'} are used" in caplog.text


def test_whole_episodes_outlive_one_that_fails(file, monkeypatch):
    def make():
        robot = fake_lerobot.FakeRobot()
        robot.fails_at = STEPS + 4
        return robot

    monkeypatch.setattr(fake_lerobot, "make", make)
    with pytest.raises(RobotError, match="does not move: ConnectionError: the bus is silent"):
        make_real(file).collect(3)
    assert make_real(file).num_filmed == 1
    with pytest.raises(InputError, match=r"was stopped \(.*the bus is silent"):
        make_real(file).collect(3)
    (file.parent / "arm.toml.stopped").unlink()
    monkeypatch.undo()
    assert len(make_real(file).collect(3)) == 3


@pytest.mark.parametrize("error", [KeyboardInterrupt, RobotError("the bus is silent")])
def test_what_ended_a_session_shows_though_the_robot_does_not_disconnect(
    file, monkeypatch, caplog, error
):
    def disconnect(_):
        raise RuntimeError("device is not connected")

    def fail(_):
        raise error

    monkeypatch.setattr(fake_lerobot.FakeRobot, "disconnect", disconnect)
    with pytest.raises(error if isinstance(error, type) else type(error), match=r"^(the bus.*)?$"):
        make_real(file).run_policy(fail, num_stacked=1, num_episodes=1, seed=1)
    assert "the robot does not disconnect: RuntimeError: device is not" in caplog.text
    (file.parent / "arm.toml.stopped").unlink(missing_ok=True)
    with pytest.raises(RobotError, match="the robot does not disconnect"):
        make_real(file).collect(1)


def test_a_policy_sees_the_latest_pictures_and_acts_in_its_own_units(file):
    seen = []

    def policy(frames: np.ndarray) -> np.ndarray:
        seen.append(frames)
        return np.array([[0.5]])

    real = make_real(file)
    (trajectory,) = real.run_policy(policy, num_stacked=3, num_episodes=1, seed=1)
    assert seen[0].shape == (1, 3, 16, 16, 3)
    assert len(seen) == CALLS_BEFORE_REPLAY + STEPS  # the first times only to get warm
    np.testing.assert_array_equal(seen[1][0, 0], seen[1][0, 2])
    assert (seen[-1][0, 0] > seen[-1][0, 2]).all()  # it goes back by 2 a step
    np.testing.assert_allclose(trajectory.actions, 0.5, atol=1e-5)


def test_what_a_policy_did_to_get_warm_is_forgotten_before_each_episode(file):
    done = []
    real = make_real(file)
    real.run_policy(
        lambda _: done.append("act") or np.zeros((1, 1)), 3, 2, 1, lambda: done.append("begin")
    )
    episode = ["begin", *["act"] * CALLS_BEFORE_REPLAY, "begin", *["act"] * STEPS]
    assert done == 2 * episode


def test_an_ill_policy_stops_the_robot(file):
    real = make_real(file)
    with pytest.raises(RobotError, match="an action must be finite"):
        real.run_policy(lambda _: np.array([[np.nan]]), num_stacked=1, num_episodes=1, seed=1)
    places = [action["pan.pos"] for action in fake_lerobot.latest[-1].sent]
    assert places == pytest.approx([1.0] * len(places), abs=1e-3)
    assert "must be finite" in (file.parent / "arm.toml.stopped").read_text()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_process_that_is_told_to_end_stops_the_robot(file, monkeypatch, number):
    before = {n: signal.signal(n, signal.SIG_DFL) for n in (signal.SIGTERM, signal.SIGHUP)}
    stop, calls = LeRobot.stop, []

    def stop_at_last(arm):
        for impatient in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            signal.raise_signal(impatient)
        stop(arm)

    def policy(_):
        calls.append(None)
        if len(calls) == CALLS_BEFORE_REPLAY + 3:
            signal.raise_signal(number)
        return np.ones((1, 1))

    monkeypatch.setattr(LeRobot, "stop", stop_at_last)
    try:
        with pytest.raises(SystemExit) as ended:
            make_real(file).run_policy(policy, num_stacked=1, num_episodes=1, seed=1)
        assert [signal.getsignal(n) for n in before] == [signal.SIG_DFL] * 2
    finally:
        for n, former in before.items():
            signal.signal(n, former)
    assert ended.value.code == 128 + number
    robot = fake_lerobot.latest[-1]
    assert robot.sent[-1] == pytest.approx(robot.sent[-2], abs=1e-3)  # to stay where it is
    assert number.name in (file.parent / "arm.toml.stopped").read_text()
    assert not robot.is_connected


def test_a_hangup_that_is_ignored_ends_nothing(file):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as under nohup

    def policy(_):
        signal.raise_signal(signal.SIGHUP)
        return np.zeros((1, 1))

    try:
        assert make_real(file).run_policy(policy, num_stacked=1, num_episodes=1, seed=1)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_robot_that_does_not_know_where_it_is_is_sent_nowhere(file):
    def policy(_):
        fake_lerobot.latest[-1].place = {"pan.pos": float("nan"), "lift.pos": 25.0}
        return np.zeros((1, 1))

    with pytest.raises(RobotError, match=r"a place must be 2 finite numbers, got \[nan, 25.0\]"):
        make_real(file).run_policy(policy, num_stacked=1, num_episodes=1, seed=1)
    assert np.isfinite([list(action.values()) for action in fake_lerobot.latest[-1].sent]).all()


def test_what_the_robot_did_not_do_is_not_recorded(file):
    file.write_text(LEROBOT.replace("-pan.pos", "lift.pos"))
    (trajectory,) = make_real(file).run_policy(lambda _: np.ones((1, 1)), 1, 1, seed=0)
    # From 25 by 4 a step, but it does not get beyond 30.
    np.testing.assert_allclose(trajectory.actions[:, 0], [1, 0.25, 0, 0], atol=1e-5)


def test_each_episode_waits_for_a_person(file, monkeypatch, capsys):
    file.write_text(LEROBOT.replace("ask = false", "ask = true"))
    with pytest.raises(InputError, match="nobody can say when an episode may begin"):
        make_real(file).collect(2)

    class Terminal:
        asked = 0

        def isatty(self):
            return True

        def fileno(self):
            raise OSError

        def readline(self):
            self.asked += 1
            if self.asked % 2 == 0:  # it is at its start
                assert fake_lerobot.latest[-1].place["pan.pos"] == pytest.approx(1, abs=2.5)
            return "\n"

    terminal = Terminal()
    monkeypatch.setattr(sys, "stdin", terminal)
    make_real(file).collect(2)
    assert terminal.asked == 4
    said = capsys.readouterr().err
    assert "episode 2 of 2: clear the robot's way to its start, then press Enter" in said
    assert "episode 2 of 2: set the scene up, and stand back, then press Enter" in said


def test_what_was_typed_before_it_was_asked_does_not_count(monkeypatch):
    keyboard, terminal = os.openpty()
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        os.write(keyboard, b"\n\n")  # an Enter too many, while the robot moved
        asked = threading.Thread(target=robot._ask, args=("episode 1 of 1",), daemon=True)
        asked.start()
        asked.join(0.3)
        assert asked.is_alive(), "it waits for another"
        os.write(keyboard, b"\n")
        asked.join(5)
        assert not asked.is_alive()
    os.close(keyboard)


def test_a_task_whose_actions_are_controls_is_not_for_a_robot(file):
    forces = replace(TASK, map_actions=DirectActions)
    with pytest.raises(InputError, match='have the tuning file say mapping = "mocap" or "joints"'):
        make_real(file, forces)


def test_nothing_moves_unless_it_is_said(file):
    with pytest.raises(InputError, match="give --move"):
        make_real(file, move=False).collect(1)
    with pytest.raises(InputError, match=r"dry run: .* pan.pos 0.0, lift.pos 20.0.*64×48.*--move"):
        choose_real(RealConfig(real="lerobot", robot=file), TASK, 16, out=file.parent / "run")
    assert not fake_lerobot.latest[-1].sent
    assert not (file.parent / "run").exists()


def may_film(config: TrainConfig) -> None:
    """As a training looks, before anything is written."""
    real, _, _ = choose_real(config, TASK, 16, out=config.out)
    check_filmed(config, choose_schedule(config, TASK, choose_search(config)), real)


def test_a_training_that_will_have_to_move_the_robot_says_so_before_it_begins(file):
    out = file.parent / "run"
    config = TrainConfig(task="cartpole", out=out, real="lerobot", robot=file, real_episodes=2)
    make_real(file, folder=out / "filmed").collect(1)
    for changes, message in (
        ({}, "needs 2 episodes, and then up to 2 of its policy .*, and 1 are filmed: give --move"),
        ({"tried_episodes": 0}, "needs 2 episodes, and 1 are filmed: give --move"),
    ):
        with pytest.raises(InputError, match=message):
            may_film(replace(config, **changes))
        may_film(replace(config, **changes, move=True))
    make_real(file, folder=out / "filmed").collect(2)
    may_film(replace(config, tried_episodes=0))
    with pytest.raises(InputError, match="the robot has to move for this"):
        may_film(config)
    pretrained = replace(config, tried_episodes=0, pretrain_steps=1000)
    with pytest.raises(InputError, match="needs 2 episodes of its policy, and 2 are filmed"):
        may_film(pretrained)
    tuning = TuneConfig(task="cartpole", out=out, real="lerobot", robot=file)
    choose_real(replace(tuning, observe="cameras"), TASK, 16, out=out)


def test_a_training_goes_on_without_the_robot_once_all_its_cycles_have_filmed(file, monkeypatch):
    out = file.parent / "run"
    asked = {"task": "cartpole", "out": out, "real": "lerobot", "robot": file}
    config = TrainConfig(**asked, preset="paper")  # 12 cycles of 5 episodes
    monkeypatch.setattr(RobotReal, "num_filmed", 59)
    problem = SimpleNamespace(real=make_real(file), recordings=[])
    monkeypatch.setattr(training_experiment, "build_problem", lambda *_, **__: problem)
    refused = partial(pytest.raises, InputError, match="5 episodes, .* 55 of its policy.* 59 are")
    with refused():
        training_experiment.build_training(config)
    out.mkdir()
    for state, is_refused in (
        ({"filmings": 3}, True),
        ({"filmings": 11, "knows_enough": False}, True),
        ({"filmings": 3, "knows_enough": True}, False),
        ({"filmings": 12}, False),  # a search that ended early filmed nothing in most of them
    ):
        checkpoint.save(out / "checkpoints", {}, state)
        with refused() if is_refused else nullcontext():
            check_filmed(config, choose_schedule(config, TASK, "paper"), problem.real)


@pytest.mark.parametrize("method", ["dr", "untuned"])
def test_a_training_without_a_search_needs_no_move(file, method):
    out = file.parent / "run"
    config = TrainConfig(task="cartpole", out=out, real="lerobot", robot=file, method=method)
    may_film(config)
    real, _, _ = choose_real(config, TASK, 16, out=out)
    with pytest.raises(InputError, match="has to move for this: give --move"):
        real.collect(1)


def test_a_robot_is_moved_by_one_command_at_a_time(file):
    real = make_real(file)
    with file.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another simtune is moving the robot"):
            real.collect(1)


@pytest.mark.slow
def test_tune_resumes_without_the_robot(file, quick, monkeypatch):
    monkeypatch.setitem(TASKS, "arm", lambda: replace(TASK, episode_steps=24))
    out = file.parent / "run"
    asked = {"task": "arm", "out": out, "real": "lerobot", "robot": file}
    config = TuneConfig(**asked, real_episodes=1, budget_minutes=1e-5, move=True)
    result = tune(config, settings=quick)
    assert (result["real"], result["real_episodes"]) == ("lerobot", 1)
    assert (out / "report.html").is_file()
    made = len(fake_lerobot.latest)
    tune(replace(config, move=False, budget_minutes=1e-4), settings=quick)
    assert len(fake_lerobot.latest) == made


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("address =", "adress =", r"arm.toml:2: no key 'adress'.*did you mean 'address'"),
        ("step = 4", "step = 0", "arm.toml:9: step must be a finite number above 0, got 0"),
        ("step = 4", "", r"\[actions\] has no step"),
        ('"-pan.pos"', '"-tilt.pos"', "no axis '-tilt.pos' in the workspace"),
        ('"-pan.pos"', '["pan.pos", "-pan.pos"]', "two actions move one axis"),
        ("[-20, 20]", "[20, -20]", "must be two numbers, the lower one first"),
        ('"pan.pos" = 1', '"pan.pos" = 21', "start pan.pos = 21 lies outside of the workspace"),
        ("speed = 100", "", "has no speed: expected a finite number"),
        ("tolerance = 3", "", "has no tolerance: expected a finite number"),
        ("tolerance = 3", "tolerance = 4.1", "at most a tenth of the .*narrowest axis, 4, got 4.1"),
        ("recorded_px = 32", "recorded_px = 33", "recorded_px must be even"),
        ("ask = false", "ask = 0", "ask must be true or false, got 0"),
        ('"-pan.pos"', '["pan.pos", "lift.pos"]', r"cartpole takes 1 actions \(slide\), 'moved'"),
        ("fake_lerobot:make", "fake_lerobot:mak", "fake_lerobot:mak makes no robot"),
        ('"lift.pos"', '"lif.pos"', "no axis 'lif.pos' in the robot's.*mean 'lift.pos'"),
        ("[camera]", '[camera]\nname = "frnt"', "no camera 'frnt' in .*did you mean 'front'"),
    ],
)
def test_unusable_robot_files(file, old, new, message):
    file.write_text(LEROBOT.replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        make_real(file).collect(1)
    assert "\n" not in str(error.value)
    assert not (file.parent / "filmed").exists()


def test_a_factory_that_ends_the_program_makes_no_robot(tmp_path):
    (tmp_path / "leaving.py").write_text("import sys\n\ndef make():\n    sys.exit('no bus')\n")
    with pytest.raises(InputError, match="leaving:make makes no robot: SystemExit: no bus"):
        make_lerobot("leaving:make", tmp_path)


def test_the_manuals_examples_can_be_read(tmp_path):
    manual = (Path(__file__).parents[2] / "docs" / "robot.md").read_text()
    examples = re.findall(r"```toml\n(.*?)```", manual, re.DOTALL)
    for driver, text in zip(("xarm", "lerobot"), examples, strict=True):
        (tmp_path / "arm.toml").write_text(text)
        assert read_robot(tmp_path / "arm.toml", driver).ask


def test_the_manuals_robots_are_fast_enough_for_their_actions(tmp_path):
    manual = (Path(__file__).parents[2] / "docs" / "robot.md").read_text()
    examples = re.findall(r"```toml\n(.*?)```", manual, re.DOTALL)
    for driver, text, step_s in zip(("xarm", "lerobot"), examples, (0.3, 0.1), strict=True):
        (tmp_path / "arm.toml").write_text(text)
        robot = read_robot(tmp_path / "arm.toml", driver)
        assert robot.step * np.sqrt(len(robot.moved)) <= robot.speed * step_s


def test_a_robot_too_slow_for_its_actions_is_told_of(file, caplog):
    make_real(file)  # 100 a second, 0.1 s, 4 a step
    assert not caplog.messages
    file.write_text(LEROBOT.replace("speed = 100", "speed = 10"))
    make_real(file)
    (said,) = caplog.messages
    assert (
        "with speed = 10 the robot goes 1 within a step of 0.1 s, and the task's actions go up"
        in said
    )
    assert "give a speed above 40" in said


def test_an_xarm_goes_as_far_as_the_tasks_hand(tmp_path):
    manual = (Path(__file__).parents[2] / "docs" / "robot.md").read_text()
    text = re.findall(r"```toml\n(.*?)```", manual, re.DOTALL)[0]
    task, changes = load_task("rope_peg"), {"image_size": 16, "seed": 0, "move": True}
    for step, is_right in (("25", True), ("24", False), ("2.5", False)):
        (tmp_path / "arm.toml").write_text(re.sub("step = [0-9.]+", f"step = {step}", text))
        config = read_robot(tmp_path / "arm.toml", "xarm")
        refused = pytest.raises(InputError, match=f"step = {step} mm, .*0.025: expected step = 25")
        with nullcontext() if is_right else refused:
            RobotReal(config, task, folder=tmp_path / "filmed", **changes)


def test_an_xarm_has_limits_of_its_own(file):
    text = LEROBOT.replace('"pan.pos"', "x").replace('"lift.pos"', "z").replace("-pan.pos", "x")
    text = text.replace("z = [0, 40]", "y = [-100, 100]\nz = [0, 40]") + "\n[start]\n"
    text = text.replace("[start]\nx = 1", "[start]\ny = 0\nx = 1").removesuffix("[start]\n")
    text = text.replace("fake_lerobot:make", "192.168.1.203")
    file.write_text(text)
    assert read_robot(file, "xarm").speed == 100
    file.write_text(text.replace("speed = 100", ""))
    assert read_robot(file, "xarm").speed == 100  # mm/s
    as_written = re.search(r"\[workspace\]\n(.*\n)(.*\n)(.*\n)", text)
    file.write_text(
        text.replace(as_written[0], "[workspace]\n" + "".join(as_written.groups()[::-1]))
    )
    assert tuple(read_robot(file, "xarm").workspace) == ("x", "y", "z")
    for old, new, message in (
        ("speed = 100", "speed = 251", "speed must be at most 250 mm/s, got 251"),
        ("ask = false", "collision_sensitivity = 6", "must be 1 to 5, got 6"),
        ("ask = false", "acceleration = 2001", "at most 2000 mm/s², got 2001"),
        ("[-100, 100]", "[-100, 1001]", "more than 1000 mm from the base, farther than any xArm"),
        ("y = [-100, 100]", "w = [-1, 1]", "y|w"),
        ("192.168.1.203", "my_arm.local", "address must be the controller's IP address"),
    ):
        file.write_text(text.replace(old, new))
        with pytest.raises(InputError, match=message):
            read_robot(file, "xarm")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--real", "xarm"], "--real xarm needs --robot FILE.toml"),
        (["--robot", "FILE"], "--robot and --move go with --real xarm or lerobot only"),
        (["--move"], "--robot and --move go with"),
        (["--real", "xarm", "--robot", "NOWHERE"], "nowhere.toml: no such folder or file"),
        (["--real", "lerobot", "--robot", "FILE", "--camera", "front"], "--camera goes with rec"),
        (["--real", "lerobot", "--robot", "FILE"], "a step every 0.08 s; a camera needs"),
    ],
)
@pytest.mark.parametrize("command", ["tune", "train"])
def test_commands_refuse_what_cannot_be(file, monkeypatch, capsys, command, arguments, message):
    places = {"FILE": str(file), "NOWHERE": str(file.with_name("nowhere.toml"))}
    words = [places.get(word, word) for word in arguments]
    out = str(file.parent / "out")
    monkeypatch.setattr(sys, "argv", ["simtune", command, "cartpole", "--out", out, *words])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    (said,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("simtune")]
    assert exit_.value.code == 2
    assert re.search(message, said), said
    assert not Path(out).exists()


def test_a_stop_needs_no_picture(file):
    """Observations include pictures, and a camera may be what failed."""
    fake = fake_lerobot.FakeRobot()
    arm = LeRobot(fake, ["pan.pos", "lift.pos"])
    with pytest.raises(RobotError, match="cannot be stopped"):
        arm.stop()
    arm.connect()
    assert arm.measure().tolist() == [0, 20]
    fake.get_observation = lambda: {}["camera"]
    arm.stop()
    assert fake.sent == [{"pan.pos": 0.0, "lift.pos": 20.0}]


def test_what_a_robots_pictures_cannot_be_is_refused(file):
    lens = Lens(64, 48, 50.0, 50.0, 31.5, 23.5)
    with pytest.raises(InputError, match="has a lens or a region, and a robot's camera is used as"):
        make_real(file, replace(TASK, cameras=(replace(TASK.cameras[0], lens=lens),)))
