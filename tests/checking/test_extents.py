"""How many pixels what moves has, by hand, and what is said where they are few."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simtune.cameras.views import View
from simtune.checking.extents import extents_px, small_in_pictures, unclear_of
from simtune.checking.image_size import choose_image_size
from simtune.checking.table import _extents
from simtune.config import CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.recordings import write_dataset
from simtune.tasks import Task, load_any_task
from simtune.trajectory import Trajectory

SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1" fovy="53.13"/>
    <geom name="wall" type="box" pos="0 3 0" size="3 .1 3"/>
    <body name="plate">
      <joint name="x" type="slide" axis="1 0 0"/>
      <geom name="plate" type="box" size=".5 .001 .125"/>
      <geom name="contact" type="box" size="2 2 2" group="3" contype="0" conaffinity="0"/>
    </body>
    <body name="turned" pos="0 0 1" euler="0 30 0">
      <joint name="y" type="slide" axis="1 0 0"/>
      <geom name="turned" type="box" size=".5 .001 .0625"/>
    </body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
"""
TUNING = """model = "scene.xml"
control_timestep_s = 0.02
camera = "front"
[[parameters]]
name = "mass"
kind = "mass"
objects = "plate"
"""


@pytest.mark.parametrize("size", [64, 128])
def test_extents_are_across_what_moves(folder, load, size):
    (folder / "scene.xml").write_text(SCENE)
    simulator = load(TUNING).simulator(image_size=size, views=[View("front")])
    worlds, rng = np.tile(simulator.space.nominal, (2, 1)), np.random.default_rng(0)
    states = simulator.roll_out(worlds, np.zeros((2, 5, 1)), rng).states
    found = extents_px(simulator, states, simulator.views)
    # 53.13° see 4 m at a distance of 4 m; of boxes the narrow sides count: .25 and .125 m.
    assert found == pytest.approx({"plate": size / 16, "turned": size / 32}, rel=0.02)


CLOTH = """
    <flexcomp name="cloth" type="grid" dim="2" count="5 3 1" spacing=".25 .25 .25" euler="90 0 0"
              radius=".01" mass=".1"><edge equality="true"/></flexcomp>
  </worldbody>"""


def test_a_cloth_is_as_large_as_its_vertices_show(folder, load):
    """5 by 3 vertices .25 m apart, before a camera that sees 4 m: the narrow side is .5 m."""
    (folder / "scene.xml").write_text(SCENE.replace("</worldbody>", CLOTH))
    simulator = load(TUNING).simulator(image_size=64, views=[View("front")])
    worlds, rng = np.tile(simulator.space.nominal, (1, 1)), np.random.default_rng(0)
    states = simulator.roll_out(worlds, np.zeros((1, 2, 1)), rng).states
    assert extents_px(simulator, states, simulator.views)["cloth"] == pytest.approx(8.0, rel=0.02)


def test_what_leaves_the_picture_is_as_large_as_it_was_in_it(folder, load):
    (folder / "scene.xml").write_text(SCENE)
    simulator = load(TUNING).simulator(image_size=64, views=[View("front")])
    worlds, rng = np.tile(simulator.space.nominal, (1, 1)), np.random.default_rng(0)
    states = simulator.roll_out(worlds, np.zeros((1, 11, 1)), rng).states
    space = simulator.state_space
    moved = space.positions_and_velocities(states).copy()
    for first, size in ((3, 4.0), (1, 0.0)):  # in sight in a quarter of them, and in hardly any
        moved[:, first:, 0] = 50.0
        states = space.with_positions_and_velocities(states, moved)
        found = extents_px(simulator, states, simulator.views)
        assert found["plate"] == pytest.approx(size, rel=0.02)
    (said,) = small_in_pictures({"ball": 0.0}, 64, {})
    assert "nothing that moves is in sight" in said


def test_where_all_is_small_something_is_said():
    assert small_in_pictures({}, 64, {}) == []
    assert small_in_pictures({"arm": 9.0, "finger": 1.0}, 64, {}) == []
    (said,) = small_in_pictures({"bob": 2.6, "rod": 0.5}, 64, {"rod": ["rod_mass"]})
    assert _extents({"bob": 2.61, "rod": 0.5}, 64).endswith("pixels of 64: bob 2.6, rod 0.5")
    assert _extents({"bob": 0.0, "rod": 2.0}, 64).endswith(": rod 2.0, bob mostly out of sight")
    assert "bob, is 2.6 of 64 pixels across. --image-size 128 would show 5.2, if" in said


@pytest.mark.parametrize(
    ("recorded_px", "advice"),
    [
        (480, "--image-size 128 would show 5.2; or look at a region of the recordings alone"),
        (96, "--image-size 96 would show 3.9; or film it from nearer by"),
        (64, "film it from nearer by"),
    ],
)
def test_larger_pictures_are_asked_for_only_where_recordings_have_them(recorded_px, advice):
    (said,) = small_in_pictures({"bob": 2.6}, 64, {}, recorded_px)
    assert said.startswith(
        f"what moves is small: the largest, bob, is 2.6 of 64 pixels across. {advice}"
    )
    (said,) = small_in_pictures({"bob": 0.5}, 64, {}, 1080)
    assert "--image-size 256 would show 2.0;" in said, "no command takes more"


def test_what_shows_little_and_is_small_is_said():
    unclear = {"box": ["box_mass", "box_friction"], "arm": ["arm_mass"], "hidden": ["lid"]}
    (said,) = small_in_pictures({"arm": 9.0, "box": 2.0, "hidden": 0.0}, 64, unclear)
    assert said.startswith("box_mass, box_friction: box is 2.0 of 64 pixels across. --image-size")
    assert small_in_pictures({"arm": 9.0, "box": 5.0}, 64, unclear) == []


def test_parameters_are_of_their_bodies(folder, load):
    (folder / "scene.xml").write_text(SCENE)
    colour = '[[parameters]]\nname = "c"\nkind = "colour"\nobjects = "turned"\n'
    simulator = load(TUNING + colour).simulator(image_size=16, views=[View("front")])
    verdicts = {"mass": "clear", "c_r": "weak", "c_g": "clear", "c_b": "weak"}
    assert unclear_of(simulator, verdicts, "clear") == {"turned": ["c_r", "c_b"]}


def far(folder: Path) -> str:
    """A tuning file whose largest moving part has 2 of 64 pixels: .25 of 8 m."""
    (folder / "scene.xml").write_text(SCENE.replace('pos="0 -4 0"', 'pos="0 -8 0"'))
    (path := folder / "tune.toml").write_text(TUNING)
    return str(path)


def test_pictures_are_larger_where_what_moves_is_small(folder, caplog):
    caplog.set_level("INFO")
    task = load_any_task(path := far(folder))
    config = TuneConfig(task=path, out=folder / "run")
    assert choose_image_size(config, task, "posterior") == 128  # not 160, which would show five
    assert "pictures are 128 pixels high, not 64, since what moves has 2.0" in caplog.text
    assert choose_image_size(CheckConfig(task=path), task, "posterior") == 128
    assert choose_image_size(replace(config, image_size=48), task, "posterior") == 48
    assert choose_image_size(config, task, "paper") == 100
    (folder / "scene.xml").write_text(SCENE)
    near = load_any_task(path)  # twice as near: 4 pixels
    assert choose_image_size(config, near, "posterior") == 64


def test_recordings_that_are_missing_are_said_before_any_world_is_made(folder, monkeypatch):
    task = load_any_task(path := far(folder))
    monkeypatch.setattr(Task, "simulator", lambda *_, **__: pytest.fail("made a simulator"))
    for config in (
        TuneConfig(task=path, out=folder / "run", real=str(folder / "none")),
        CheckConfig(task=path, real=str(folder / "none")),
    ):
        with pytest.raises(InputError, match="no such folder"):
            choose_image_size(config, task, "posterior")


@pytest.mark.parametrize(("recorded_px", "chosen"), [(48, 64), (96, 96), (240, 128)])
def test_pictures_are_not_larger_than_recorded(folder, recorded_px, chosen):
    task = load_any_task(path := far(folder))
    frames = np.zeros((13, recorded_px, recorded_px, 3), np.uint8)
    film = Trajectory(frames, np.zeros((12, 1), np.float32), 0.02)
    named = {"action_names": ["motor"], "robot_type": "none", "task": "none"}
    write_dataset(folder / "film", [film], **named)
    config = TuneConfig(task=path, out=folder / "run", real=str(folder / "film"))
    assert choose_image_size(config, task, "posterior") == chosen
