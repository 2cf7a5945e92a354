"""Pixels where metres are meant, and joints that begin elsewhere than simulated ones."""

from pathlib import Path

import numpy as np
import pytest
from test_turned_films import RANGE, SCENE, STEPS, TUNE, Scene, write_task

from simtune.checking import check
from simtune.checking.mistakes.lengths import far_beyond_model
from simtune.checking.starts import far_starts
from simtune.config import CheckConfig
from simtune.recordings import write_dataset
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory


@pytest.fixture(scope="module")
def task(tmp_path_factory) -> Task:
    return write_task(tmp_path_factory.mktemp("plane"))


@pytest.fixture(scope="module")
def simulator(task) -> Simulator:
    return task.simulator(image_size=16)


def test_commands_and_readings_in_pixels_are_asked_about(task, simulator):
    metres = [np.linspace(-0.2, 0.2, STEPS)[:, None] * [1, 0.5]] * 2
    read = np.stack([np.vstack([its, its[-1:]]) for its in metres])
    assert far_beyond_model(simulator, metres, task.sensors, read) == []
    pixels, far = [1000 * its + 256 for its in metres], 1000 * read + 256
    (said,) = far_beyond_model(simulator, pixels, task.sensors, far)
    assert said.startswith("x is commanded over 400 m and reads over 398 m, in a model ")
    assert "are these pixels or mm?" in said
    assert said.endswith(" (likewise y)")
    # Readings alone are compared with commands elsewhere, but of a joint without any
    assert far_beyond_model(simulator, metres, task.sensors, far) == []
    (said,) = far_beyond_model(simulator, pixels)
    assert said.startswith("x is commanded over 400 m, in a model ")


def test_readings_in_pixels_of_joints_that_nothing_commands_are_asked_about(tmp_path):
    motors = SCENE.format(range=RANGE).replace('<position name="p', '<motor name="p')
    motors = motors.replace(' kp="100" kv="15"', "")
    (tmp_path / "scene.xml").write_text(motors)
    (tmp_path / "tune.toml").write_text(TUNE.format(joints='["x", "y"]'))
    task = load_task(str(tmp_path / "tune.toml"))
    read = np.random.default_rng(0).uniform(0, 500, (2, STEPS + 1, 2)) * [1, 1e-4]
    simulator, actions = task.simulator(image_size=16), [np.zeros((STEPS, 2))] * 2
    (said,) = far_beyond_model(simulator, actions, task.sensors, read)
    assert said.startswith("x reads over 48")
    assert "likewise" not in said


def test_of_pixels_check_says_one_sentence_and_not_what_follows_from_it(tmp_path, monkeypatch):
    monkeypatch.setattr("simtune.checking.sensitive_starts.MUCH", 0.0)  # every start is sensitive
    write_task(tmp_path)
    text = (tmp_path / "tune.toml").read_text().replace('"observation.state"', '["x", "y"]')
    (tmp_path / "tune.toml").write_text(text)
    swing = 0.2 * np.sin(np.arange(31)[:, None] * [0.2, 0.13])
    metres, frames = swing[:-1], np.zeros((31, 16, 16, 3), np.uint8)
    in_pixels = (1000 * metres + 256).astype(np.float32)
    write_dataset(
        tmp_path / "film",
        [Trajectory(frames, in_pixels, 0.1, {"pusher": 1000 * swing + 256})],
        action_names=["px", "py"],
        robot_type="pusher",
        task="push",
        reading_names={"pusher": ["x", "y"]},
    )
    found = check(CheckConfig(task=str(tmp_path / "tune.toml"), real=tmp_path / "film"))
    (said,) = found["warnings"]
    assert "are these pixels or mm?" in said
    assert "films" not in found


def with_starts(folder: Path, limits: str, more: str = "", offset: str = "offset = 0\n") -> Task:
    (folder / "scene.xml").write_text(SCENE.format(range=limits))
    text = TUNE.format(joints='["x", "y"]').replace("offset = 0\n", offset)
    (folder / "tune.toml").write_text(text.replace("[[parameters]]", more + "[[parameters]]"))
    return load_task(str(folder / "tune.toml"))


NARROW = '[initial_state]\nkind = "distribution"\njoints.x = { position = [-0.01, 0.01] }\n\n'


SAY = "say in [initial_state] where it begins"


@pytest.mark.parametrize(
    ("limits", "more", "offset", "says"),
    [
        ("", "", "offset = 0\n", f"give the joint a range, or {SAY}"),
        ("", "", "", f"give the joint a range, or {SAY}"),  # wherever their zero is
        (RANGE, "", "offset = 0\n", None),
        (RANGE, NARROW, "offset = 0\n", SAY),
    ],
)
def test_readings_that_begin_far_from_simulated_starts(tmp_path, limits, more, offset, says):
    task = with_starts(tmp_path, limits, more, offset)
    read = np.zeros((4, STEPS + 1, 2))
    read[:, 0] = np.array([[-0.24, 0.2], [0.1, -0.2], [0.24, 0.0], [0, 0]])
    found = far_starts(task.simulator(image_size=16), task.sensors, read, 0)
    if says is None:
        assert found == []
        return
    (said,) = found
    assert said.startswith("x begins at -0.24 to 0.24 m in readings, and at -0.")
    assert said.endswith(f"in simulated worlds: {says} (likewise y)")
    near = far_starts(task.simulator(image_size=16), task.sensors, 0.01 * read, 0)
    assert near == []


PENDULUM = """<mujoco><worldbody><body name="pole"><joint name="h" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.4"/></body></worldbody></mujoco>"""
OF_PENDULUM = """
model = "scene.xml"
control_timestep_s = 0.05
{start}
[[sensors]]
name = "encoder"
joints = "h"
{offset}
[[parameters]]
name = "mass"
kind = "mass"
objects = "pole"
"""


@pytest.mark.parametrize("start", ["", NARROW.replace("joints.x", "joints.h")])
@pytest.mark.parametrize("offset", ["offset = 0", ""])
def test_an_encoder_of_an_endless_hinge_may_begin_at_any_turn(tmp_path, start, offset):
    (tmp_path / "scene.xml").write_text(PENDULUM)
    (tmp_path / "tune.toml").write_text(OF_PENDULUM.format(start=start, offset=offset))
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, read = task.simulator(image_size=16, views=()), np.zeros((2, STEPS + 1, 1))
    read[:, 0, 0] = 6.27, 0.01 + 2 * np.pi
    assert far_starts(simulator, task.sensors, read, 0) == []
    read[:, 0, 0] = 1.0, 3.0
    says = far_starts(simulator, task.sensors, read, 0)
    assert [its.endswith(f"in simulated worlds: {SAY}") for its in says] == [True] * bool(start)


def test_a_scene_whose_readings_are_simulated_begins_where_it_does(task):
    scene = Scene(task)
    values = scene.readings["pusher"]
    assert far_starts(scene.simulator, task.sensors, values, 0) == []
