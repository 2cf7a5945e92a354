"""Where a camera is, found by the joints of a robot that it films."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from simtune import cli
from simtune.camera_pose.align import FINE, NEAR, Alignment, Camera, _ways
from simtune.camera_pose.edges import edges
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.scene import measured_states, with_any_camera, without_the_robot
from simtune.camera_pose.search import Found
from simtune.camera_pose.silhouettes import likely_cameras, moving_masks
from simtune.camera_pose.written import describe, tuning_table
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.real.choose import observed
from simtune.recordings import write_dataset
from simtune.tasks import Task, load_task

SIZE, FRAMES = 64, 14
ARM = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <light pos="0 -2 3" dir="0 .5 -1"/>
    <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.4" rgba=".4 .5 .6 1"/>
    <body name="upper">
      <joint name="shoulder" axis="0 0 1" damping="1"/>
      <joint name="lift" axis="0 1 0" damping="1"/>
      <geom name="upper" type="capsule" fromto="0 0 0 .35 0 0" size=".05" rgba=".8 .3 .2 1"/>
      <body name="fore" pos=".35 0 0">
        <joint name="elbow" axis="0 1 0" damping="1"/>
        <geom name="fore" type="capsule" fromto="0 0 0 .3 0 0" size=".04" rgba=".2 .7 .3 1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="shoulder" kp="20"/><position name="b" joint="lift" kp="20"/>
    <position name="c" joint="elbow" kp="20"/>
  </actuator>
</mujoco>
"""
TUNING = """
model = "arm.xml"
control_timestep_s = 0.1
episode_steps = 11

[camera]
position_m = [0.1, -1.4, 0.8]
look_at_m = [0.1, 0.0, 0.0]
field_of_view_deg = 50

[[sensors]]
name = "arm"
joints = ["shoulder", "lift", "elbow"]
columns = "observation.state"

[[parameters]]
name = "mass"
kind = "mass"
objects = "fore"
"""


@pytest.fixture
def task(tmp_path) -> Task:
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "tune.toml").write_text(TUNING)
    return load_task(str(tmp_path / "tune.toml"))


@pytest.fixture
def options() -> CheckConfig:
    return CheckConfig(task="tune.toml", real=Path("real"), camera_pose=Path("camera.toml"))


class Filmed:
    """An arm that swings, of other colours than the model's, before a camera that is elsewhere."""

    def __init__(self, task: Task, options: CheckConfig, folder: Path):
        self.task = with_any_camera(task, task.cameras[0], options)
        seen = ObservationModel.of_reality(task.sensors, self.task.cameras)
        self.simulator, without = (
            its.simulator(image_size=SIZE, views=seen.views(), supersampling=2)
            for its in (self.task, without_the_robot(self.task))
        )
        self.robot = Robot(self.simulator, without, seen, seed=0)
        painted = ARM.replace(".8 .3 .2", ".1 .2 .7").replace(".2 .7", ".8 .7")
        (folder / "arm.xml").write_text(painted)
        self.painted = with_any_camera(load_task(task.source), task.cameras[0], options)
        (folder / "arm.xml").write_text(ARM)
        rng = np.random.default_rng(0)
        space, nothing = self.simulator.space, np.zeros((1, 0, 3))
        rest = self.simulator.roll_out(space.nominal[None], nothing, rng).states[0]
        self.states = rest.repeat(FRAMES, 0)
        self.states[:, 1:4] = rng.uniform(-1, 1, (FRAMES, 3))
        self.truth = np.array([0.6, 0.45, 0.58, 0.54, 0.42, 0.5])
        filming = self.painted.simulator(image_size=SIZE, views=seen.views(), supersampling=2)
        self.frames = Robot(filming, without, seen, seed=0).film(self.truth, self.states)


@pytest.fixture
def filmed(task, options, tmp_path) -> Filmed:
    return Filmed(task, options, tmp_path)


def test_the_camera_is_all_that_is_unknown(filmed):
    names = filmed.simulator.space.names
    assert names == tuple(f"camera_{n}" for n in ("x", "y", "z", "pitch", "yaw", "roll"))


def test_edges_say_which_way_they_run_and_not_what_is_lighter():
    column, row = np.meshgrid(np.arange(41), np.arange(41))
    for lighter, expected in (
        (column >= 20, (1, 0)),  # upright
        (row >= 20, (-1, 0)),  # level
        (column + row >= 40, (0, 1)),
        (column - row >= 0, (0, -1)),
    ):
        picture = np.where(lighter[..., None], [200, 90, 60], [60, 90, 120]).astype(np.uint8)
        along = edges(np.stack([picture, 255 - picture]), 0.0)
        np.testing.assert_allclose(along[0], along[1], atol=1e-5)
        np.testing.assert_allclose(along[0, 20, 20], expected, atol=0.05)
        assert np.abs(along[0, 5, 14]).max() < 0.01  # far from any edge


def test_of_the_robot_only_what_moves_is_left_out(filmed):
    nothing = filmed.robot.draw_without(filmed.truth, filmed.states)
    assert nothing.shape == (1, *filmed.frames.shape[1:])  # the camera stands still
    drawn = filmed.robot.draw(filmed.truth, filmed.states)
    covered = (np.abs(drawn.astype(int) - nothing) > 20).any(-1)
    assert 0.02 < covered.mean() < 0.3
    far = np.array([0.0, 0.5, 0.5, 0.5, 0.0, 0.5])  # looks elsewhere
    assert filmed.robot.draw_without(far, filmed.states).std() > 0


def test_the_field_of_view_is_looked_for_if_asked(task):
    options = CheckConfig(task="", real=Path("r"), camera_pose=Path("c.toml"), within_fov_deg=8)
    space = with_any_camera(task, task.cameras[0], options).parameters
    fov = space["camera_field_of_view"]
    assert (fov.nominal, fov.low, fov.high) == (50, 42, 58)


def test_joints_say_how_the_robot_stood(filmed, task):
    seen = ObservationModel.of_simulator(task.sensors, filmed.task.cameras)
    rng = np.random.default_rng(0)
    rollouts = filmed.simulator.roll_out(
        filmed.simulator.space.nominal[None], np.zeros((1, 5, 3)), rng, seen.observe_beside()
    )
    (trajectory,) = seen.record(filmed.simulator, rollouts, rng)
    trajectory.readings["arm"][2, 1] = np.nan
    model, rest = filmed.simulator.model, rollouts.states[0, 0]
    states = measured_states(model, seen, [trajectory, trajectory], rest)
    assert states.shape == (12, len(rest))
    np.testing.assert_allclose(states[:6, 1:4], trajectory.readings["arm"])
    assert np.isnan(states[[2, 8], 2]).all()
    assert (states[:, 4:7] == 0).all()


def test_masks_are_where_something_is_that_mostly_is_not():
    rng = np.random.default_rng(0)
    frames = rng.integers(98, 103, (9, 20, 30, 3)).astype(np.uint8)
    for t in range(9):
        frames[t, 5:10, 3 * t : 3 * t + 5] = 180
    masks = moving_masks(frames)
    assert masks[4, 5:10, 12:17].mean() > 0.8  # but its corners
    assert masks[4, 12:].sum() == 0
    assert masks[4, :, 20:].sum() == 0


def test_derivatives_are_taken_farther_where_less_changes():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    information = turn @ np.diag([100.0, 25.0, 1e-4]) @ turn.T
    ways = _ways(information)
    lengths = np.linalg.norm(ways, axis=1)
    np.testing.assert_allclose(np.sort(lengths), [1, 2, 5])
    changes = np.sqrt(np.einsum("wi,ij,wj->w", ways, information, ways))
    np.testing.assert_allclose(np.sort(changes)[1:], [10, 10])  # as much, but for the limit


@pytest.mark.thorough
def test_a_camera_near_by_is_found_by_edges_whatever_the_colours(filmed):
    start = filmed.truth + 0.03 * np.array([1, -1, 1, -1, 1, -1])
    blurs = (*NEAR, *FINE)
    alignment = Alignment(filmed.robot, filmed.frames, filmed.states, blurs)
    found = alignment.fit(start)
    # Farther away and narrower looks alike, so what is told is where the robot is on the film.
    both = filmed.robot.project(np.stack([found.unit, filmed.truth]), filmed.states)
    assert np.median(np.linalg.norm(both[0] - both[1], axis=-1)) < 0.3
    away = alignment.fit(filmed.truth + 0.25 * np.array([1, -1, 1, -1, 1, -1]))
    assert found.cost < min(away.cost, -0.005)


@pytest.mark.slow
def test_silhouettes_bring_a_camera_from_anywhere_near(filmed):
    def project(units, frames):
        return filmed.robot.project(units, filmed.states[frames])

    likely = likely_cameras(project, filmed.frames, 6, np.random.default_rng(0))
    turned = np.abs(likely[:, 3:] - filmed.truth[3:])
    assert np.median(turned) < 0.1  # of 50°: at random it would be .25


def test_what_is_written_is_the_camera_in_a_tuning_file(filmed, tmp_path):
    unit = filmed.truth
    errors = 0.01 * np.array([[1, -1, 1, -1, 1, -1], [-1, 1, -1, 1, -1, 1]])
    halves = unit + 0.006 * np.array([[1], [-1]])
    found = Found(Camera(unit, np.zeros((6, 6)), 0.0), halves, errors)
    result = describe(filmed.task, found, FRAMES)
    json.dumps(result)
    assert result["parameters"]["camera_x"]["mean"] == pytest.approx(0.1 + 0.6 * (0.6 - 0.5))
    # Student's t of two errors and two halves, and what no fit can see
    reach = 2.353363 * np.sqrt(0.01**2 + 0.006**2 + 0.002**2) * 0.6
    low = result["parameters"]["camera_x"]["low"]
    assert low == pytest.approx(result["parameters"]["camera_x"]["mean"] - reach, rel=1e-4)
    text = TUNING[: TUNING.index("[camera]")] + tuning_table(result)
    text += TUNING[TUNING.index("[[sensors]]") :]
    (tmp_path / "found.toml").write_text(text)
    model = load_task(str(tmp_path / "found.toml")).load_model()
    camera = model.camera(filmed.task.cameras[0].camera)
    np.testing.assert_allclose(camera.pos, result["position_m"])
    np.testing.assert_allclose(camera.quat, result["quat"], atol=1e-9)


def test_a_camera_at_the_end_of_its_range_is_warned_of(filmed):
    unit = np.array([1.0, 0.5, 0.5, 0.5, 0.5, 0.5])
    camera = Camera(unit, np.eye(6) * 1e-6, 0.0)
    result = describe(filmed.task, Found(camera, np.tile(unit, (2, 1)), np.zeros((4, 6))), 9)
    (said,) = result["warnings"]
    assert said.startswith("camera_x is at the end of what was searched")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"real": None}, "--camera-pose goes with recordings only"),
        ({"camera_pose": Path("pose.json")}, "expected a new file NAME.toml"),
        ({"within_m": 0}, "--within-m must be above 0"),
        ({"within_fov_deg": -1}, "--within-fov-deg must be at least 0"),
        ({"within_deg": 90}, "at most 60"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, message):
    given = {"task": "cartpole", "real": Path("real"), "camera_pose": Path("pose.toml")}
    with pytest.raises(InputError, match=message):
        CheckConfig(**(given | changes)).check()


def test_without_joints_there_is_no_pose(options):
    task = load_task("cartpole")
    with pytest.raises(InputError, match=r"declare \[\[sensors\]\]"):
        with_any_camera(task, task.cameras[0], options)


@pytest.mark.slow
def test_check_finds_where_the_camera_is(task, filmed, tmp_path, monkeypatch, capsys):
    """From 10 cm and 8° off, of a robot in other colours than the model's."""
    seen = observed(filmed.task, None, is_simulated=True)
    rng = np.random.default_rng(1)
    world = filmed.simulator.space.from_unit(filmed.truth)[None]
    simulator = filmed.painted.simulator(image_size=128, supersampling=2)
    actions = rng.uniform(-1.2, 1.2, (3, 30, 3)).repeat(2, 1)
    rollouts = simulator.roll_out(np.repeat(world, 3, 0), actions, rng, seen.observe_beside())
    names = {"arm": ["shoulder", "lift", "elbow"]}
    write_dataset(
        tmp_path / "real",
        seen.record(simulator, rollouts, rng),
        action_names=["a", "b", "c"],
        robot_type="sim",
        task="t",
        reading_names=names,
    )
    arguments = ["simtune", "check", task.source, "--real", str(tmp_path / "real"), "--json"]
    arguments += ["--camera-pose", str(tmp_path / "camera.toml"), "--budget-minutes", "0.3"]
    monkeypatch.setattr(sys, "argv", arguments)
    cli.main()
    result = json.loads(capsys.readouterr().out)
    truth = dict(zip(filmed.simulator.space.names, world[0], strict=True))
    its = result["parameters"].items()
    assert sum(found["low"] <= truth[name] <= found["high"] for name, found in its) >= 5  # of 6
    off_m = [result["position_m"][i] - truth[f"camera_{axis}"] for i, axis in enumerate("xyz")]
    assert np.linalg.norm(off_m) < 0.02
    assert (tmp_path / "camera.toml").read_text() == tuning_table(result)
