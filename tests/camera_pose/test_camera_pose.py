"""Where a camera is, found by the joints of a robot that it films."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import mujoco
import numpy as np
import pytest

from simtune import cli
from simtune.camera_pose import find, find_camera_pose, lines
from simtune.camera_pose.edges import EdgeFilm
from simtune.camera_pose.found import FoundCamera
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.robot import Outlines, Robot
from simtune.camera_pose.scene import measured_states, unlocated_geoms, with_any_camera
from simtune.camera_pose.search import End, best_end
from simtune.camera_pose.silhouettes import likely_camera, moving_masks
from simtune.camera_pose.sureness import covariance, half_widths, is_by_chance
from simtune.camera_pose.tracking import FINE, NEAR, Agreement, CameraFit, Tracker, _step
from simtune.camera_pose.written import describe, tuning_table
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.parameters import ModelWriter
from simtune.real.observed import observed
from simtune.recordings import write_dataset
from simtune.tasks import Task, load_task

SIZE, FRAMES = 240, 14
ARM = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <light pos="0 -2 3" dir="0 .5 -1"/>
    <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.4" rgba=".9 .9 .8 1"/>
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
BALL = """
<mujoco>
  <worldbody>
    <geom name="box" type="box" size=".2 .01 1" pos=".32 -1 0"/>
    <body name="ball">
      <joint name="slide" type="slide" axis="-1 0 0"/>
      <geom name="ball" type="sphere" size=".3"/>
    </body>
  </worldbody>
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
        (folder / "arm.xml").write_text(
            ARM.replace(".8 .3 .2", ".1 .2 .7").replace(".2 .7", ".8 .7")
        )
        self.painted = with_any_camera(load_task(task.source), task.cameras[0], options)
        (folder / "arm.xml").write_text(ARM)
        self.simulator = self.painted.simulator(image_size=SIZE, views=seen.views())
        rng = np.random.default_rng(0)
        self.space, nothing = self.simulator.space, np.zeros((1, 0, 3))
        rest = self.simulator.roll_out(self.space.nominal[None], nothing, rng).states[0]
        self.states = rest.repeat(FRAMES, 0)
        self.states[:, 1:4] = rng.uniform(-1, 1, (FRAMES, 3))
        self.truth = np.array([0.6, 0.45, 0.58, 0.54, 0.42, 0.5])
        worlds = np.tile(self.space.from_unit(self.truth), (FRAMES, 1))
        self.frames = self.simulator.render(self.states, worlds)
        self.camera = self.task.cameras[0].camera
        model, self.every = self.task.load_model(), np.arange(FRAMES)
        self.geometry = CameraGeometry.of(model, self.camera, self.space, (SIZE, SIZE))
        nothing_hidden = np.zeros(model.ngeom, bool)
        self.robot = Robot(model, self.camera, self.states, self.geometry, nothing_hidden)
        film = EdgeFilm(self.frames, np.median(self.frames, 0))
        self.tracker = Tracker(film, self.robot, self.geometry, self.every)

    def beside_px(self, unit: np.ndarray) -> float:
        """How far the arm is from where it is on the film."""
        points = self.robot.surface_points(self.every, np.random.default_rng(0))
        one, other = (self.geometry.project(its, points) for its in (unit, self.truth))
        return float(np.median(np.linalg.norm(one - other, axis=-1)))


@pytest.fixture
def filmed(task, options, tmp_path) -> Filmed:
    return Filmed(task, options, tmp_path)


def test_the_camera_is_all_that_is_unknown(filmed):
    names = filmed.space.names
    assert names == tuple(f"camera_{n}" for n in ("x", "y", "z", "pitch", "yaw", "roll"))


def test_a_camera_projects_as_mujoco_sees(filmed, task):
    """Points in the picture, by MuJoCo's own camera in a model that parameters are written into."""
    options = CheckConfig(task="", real=Path("r"), camera_pose=Path("c.toml"), within_fov_deg=8)
    tuned = with_any_camera(task, task.cameras[0], options)
    model, rng = tuned.load_model(), np.random.default_rng(2)
    geometry = CameraGeometry.of(model, filmed.camera, tuned.parameters, (60, 90))
    unit, points = rng.uniform(0.2, 0.8, 7), rng.uniform(-0.4, 0.4, (5, 3))
    ModelWriter(tuned.parameters, model).write(model, tuned.parameters.from_unit(unit))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    its = data.camera(filmed.camera)
    x, y, z = ((points - its.xpos) @ its.xmat.reshape(3, 3)).T
    focal_px = 30 / np.tan(np.radians(model.camera(filmed.camera).fovy[0]) / 2)
    expected = np.stack([44.5 - focal_px * x / z, 29.5 + focal_px * y / z], 1)
    np.testing.assert_allclose(geometry.project(unit, points), expected, atol=1e-9)
    np.testing.assert_allclose(geometry.lift(unit, expected, -z), points, atol=1e-9)
    behind = its.xpos + its.xmat.reshape(3, 3)[:, 2]
    assert (geometry.project(unit, behind[None]) < -1000).all()


def outline(pixels, normals, still=0.0) -> Outlines:
    """Points in the first frame."""
    num = len(pixels)
    nothing = np.zeros((num, 3))
    return Outlines(np.zeros(num, int), nothing, np.array(normals), pixels, np.full(num, still))


def strongest(film: EdgeFilm, points: Outlines) -> tuple[np.ndarray, np.ndarray]:
    steps = np.arange(-8.0, 9.0)
    strength, _ = film.across(points, points.pixels, steps)
    return steps[strength.argmax(1)], strength.max(1)


def test_edges_are_found_along_normals_whatever_is_lighter():
    column, row = np.meshgrid(np.arange(41), np.arange(41))
    normals = np.array([[1, 0], [0, 1], [0.5**0.5, 0.5**0.5]])
    start = np.array([[15.5, 12], [8, 14.5], [18, 18]])
    for lighter, its, off in ((column >= 20, 0, 4), (row >= 20, 1, 5), (column + row >= 41, 2, 4)):
        picture = np.where(lighter[..., None], [200, 90, 60], [60, 90, 120]).astype(np.uint8)
        for frame in (picture, 255 - picture):
            points = outline(start[its, None], normals[its, None])
            (place,), (strength,) = strongest(EdgeFilm(frame[None], None), points)
            assert place == pytest.approx(off, abs=1)
            assert strength > 0.1
            crossed = points._replace(normals=points.normals[:, ::-1] * [1, -1])
            assert strongest(EdgeFilm(frame[None], None), crossed)[1] < 0.02 or its == 2


def test_edges_that_stand_still_count_where_the_outlines_do():
    column = np.tile(np.arange(40), (40, 1))
    plate = np.where(column >= 24, 200, 60)
    frame = np.where(column >= 14, 120, plate)  # it hides the edge, and has one of its own
    frames = np.stack([frame, plate])[..., None].repeat(3, -1).astype(np.uint8)
    film = EdgeFilm(frames, plate[..., None].repeat(3, -1))
    moves = outline(np.array([[18.0, 20.0]]), [[1.0, 0.0]])
    assert strongest(film, moves)[0] == pytest.approx(-4.5, abs=0.6)
    later = moves._replace(frames=np.array([1]))  # nothing but what stands still
    (standing,) = strongest(film, later._replace(still=np.array([0.9])))[1]
    assert strongest(film, later)[1] < 0.2 * standing
    assert film.moving()[0, 10:30, 13:15].all()
    assert not film.moving()[1].any()


def test_outlines_of_a_ball_are_where_arithmetic_has_them(tmp_path):
    """A ball of radius r, d away, is a circle of f r / √(d² − r²); a box hides part of it."""
    (tmp_path / "arm.xml").write_text(BALL)
    (tmp_path / "tune.toml").write_text(
        TUNING.replace("0.1, 0.0, 0.0", "0, 0, 0")
        .replace("[0.1, -1.4, 0.8]", "[0, -2, 0]")
        .replace('"shoulder", "lift", "elbow"', '"slide"')
        .replace('"fore"', '"ball"')
    )
    task = load_task(str(tmp_path / "tune.toml"))
    options = CheckConfig(task="", real=Path("r"), camera_pose=Path("c.toml"))
    task = with_any_camera(task, task.cameras[0], options)
    model, size = task.load_model(), 200
    data = mujoco.MjData(model)
    states = np.zeros((2, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)))
    for state, place in zip(states, (0.0, 0.2), strict=True):
        data.qpos[:] = place
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    geometry = CameraGeometry.of(model, task.cameras[0].camera, task.parameters, (size, size))
    hidden = np.zeros(model.ngeom, bool)
    robot = Robot(model, task.cameras[0].camera, states, geometry, hidden)
    middle = np.full(6, 0.5)
    found = robot.outlines(middle, np.arange(2), 10_000)
    focal_px = size / 2 / np.tan(np.radians(25))
    first = found.frames == 0
    away = found.pixels[first] - 99.5
    radius = focal_px * 0.3 / np.sqrt(2**2 - 0.3**2)
    assert np.abs(np.linalg.norm(away, axis=1) - radius).max() < 0.8
    assert np.abs(np.linalg.norm(away, axis=1) - radius).mean() < 0.4
    edge = focal_px * 0.12 / 0.99  # of the box, which stands before the right
    assert away[:, 0].min() < -30
    assert edge - 2 < away[:, 0].max() < edge + 1
    inward = -away / np.linalg.norm(away, axis=1, keepdims=True)
    alike = (inward * found.normals[first]).sum(1)
    assert alike[away[:, 0] < edge - 5].min() > 0.95
    np.testing.assert_allclose(geometry.project(middle, found.points), found.pixels, atol=1e-6)
    assert np.median(found.still) == 0  # elsewhere in the other frame
    twice = robot.outlines(middle, np.array([0, 0]), 10_000)
    assert (twice.still == 1).all()


def test_what_may_be_anywhere_is_no_robot(task, tmp_path):
    """A box whose place nobody measures is drawn neither as robot nor as background."""
    loose = """<body name="box" pos=".3 -.6 0"><freejoint/><geom name="box" size=".4"/>
      <body name="lid"><geom name="lid" size=".1"/></body></body></worldbody>"""
    (tmp_path / "arm.xml").write_text(ARM.replace("</worldbody>", loose))
    (tmp_path / "tune.toml").write_text(TUNING)
    beside = load_task(str(tmp_path / "tune.toml"))
    options = CheckConfig(task="", real=Path("r"), camera_pose=Path("c.toml"))
    drawn = {}
    for name, its in (("alone", task), ("beside", beside)):
        its = with_any_camera(its, its.cameras[0], options)
        model, camera = its.load_model(), its.cameras[0].camera
        seen = ObservationModel.of_reality(its.sensors, its.cameras)
        hidden = unlocated_geoms(model, camera, seen)
        geoms = [model.geom(geom).name for geom in np.flatnonzero(hidden)]
        assert geoms == (["box", "lid"] if name == "beside" else [])
        simulator = its.simulator(image_size=1, views=())
        states = simulator.begin(its.parameters.nominal[None], np.random.default_rng(0)).states[0]
        geometry = CameraGeometry.of(model, camera, its.parameters, (SIZE, SIZE))
        robot = Robot(model, camera, states, geometry, hidden)
        drawn[name] = robot.outlines(np.full(6, 0.5), np.zeros(1, int), 10_000).pixels
    np.testing.assert_array_equal(drawn["alone"], drawn["beside"])
    nobody = ObservationModel.of_reality((), beside.cameras)
    model = beside.load_model()
    with pytest.raises(InputError, match="nothing that sensors measure moves"):
        Robot(model, camera, states, geometry, unlocated_geoms(model, camera, nobody))
    # Joints that carry the camera as well move nothing before it but the world.
    model.cam_bodyid[model.camera(camera).id] = model.body("fore").id
    moves = unlocated_geoms(model, camera, nobody)
    assert [model.geom(g).name for g in np.flatnonzero(~moves)] == ["fore"]


def test_a_play_leaves_nothing_anywhere(task):
    file = Path(task.source)
    file.write_text(TUNING + '[[backlash]]\njoint = "elbow"\nplay = 0.01\narmature = 0.1\n')
    loose = load_task(str(file))
    seen = ObservationModel.of_reality(loose.sensors, loose.cameras)
    model, camera = loose.load_model(), loose.cameras[0].camera
    assert model.njnt == 4
    assert not unlocated_geoms(model, camera, seen).any()


def test_the_field_of_view_is_looked_for_if_asked(task):
    options = CheckConfig(task="", real=Path("r"), camera_pose=Path("c.toml"), within_fov_deg=8)
    space = with_any_camera(task, task.cameras[0], options).parameters
    fov = space["camera_field_of_view"]
    assert (fov.nominal, fov.low, fov.high) == (50, 42, 58)


def test_joints_say_how_the_robot_stood(filmed, task):
    seen = ObservationModel.of_simulator(task.sensors, filmed.task.cameras)
    rng = np.random.default_rng(0)
    rollouts = filmed.simulator.roll_out(
        filmed.space.nominal[None], np.zeros((1, 5, 3)), rng, seen.observe_beside()
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


def test_a_camera_near_by_is_found_by_edges_whatever_the_colours(filmed):
    start = filmed.truth + 0.1 * np.array([1, -1, 1, -1, 1, -1])
    found = filmed.tracker.fit(start, (*NEAR, *FINE))
    # Farther away and narrower looks alike, so what is told is where the robot is on the film.
    assert filmed.beside_px(start) > 10
    assert filmed.beside_px(found.unit) < 0.5
    agreement = filmed.tracker.agreement(found.unit)
    assert agreement.on_edges > 0.5
    assert agreement.explained > 0.6
    assert not is_by_chance(agreement)


def test_a_wrong_camera_is_on_edges_by_chance(filmed):
    wrong = filmed.truth + np.array([0, 0, 0, 0.1, 0.1, 0.1])
    agreement = filmed.tracker.agreement(wrong)
    assert is_by_chance(agreement)
    assert agreement.score < 0.1 * filmed.tracker.agreement(filmed.truth).score
    fit = filmed.tracker.fit(filmed.truth, FINE[-1:])._replace(unit=wrong)
    result = describe(filmed.task, FoundCamera(fit, agreement, wrong[None]), FRAMES)
    assert "the robot's edges are not on the film's" in result["warnings"][0]
    assert result["parameters"]["camera_x"]["low"] == pytest.approx(0.1 - 0.3)  # not told


def test_a_robot_out_of_sight_explains_nothing(filmed):
    hidden = filmed.truth + np.array([0, 0, 0, 0, 1.5, 0])
    assert filmed.tracker.fit(hidden, NEAR) is None
    assert filmed.tracker.agreement(hidden).score == 0


def test_what_is_at_an_end_of_its_range_stays_there(filmed):
    """Two unknowns that push alike: without the first, the second does all of it."""
    slopes, off_px = np.array([[1.0, 1], [1, 0], [0, 1]]), np.array([2.0, 1, 1])
    fit = CameraFit(np.array([1.0, 0.5]), np.zeros(3, int), np.ones(3), off_px, slopes)
    np.testing.assert_allclose(_step(fit, 100, 0.0), [0, 1.5], rtol=1e-4)
    np.testing.assert_allclose(_step(fit, 100, 0.3), [1, 1], rtol=1e-4)


@pytest.mark.slow
def test_silhouettes_bring_a_camera_from_anywhere_near(filmed):
    points = filmed.robot.surface_points(filmed.every, np.random.default_rng(0))

    def project(units):
        return np.stack([filmed.geometry.project(unit, points) for unit in units])

    rng, masks = np.random.default_rng(0), moving_masks(filmed.frames)
    likely = np.stack([likely_camera(project, masks, 6, rng) for _ in range(3)])
    turned = np.abs(likely[:, 3:] - filmed.truth[3:])
    assert np.median(turned) < 0.1  # of 50°: at random it would be .25


def test_intervals_are_as_wide_as_errors_of_points_and_frames_say():
    """One unknown, eight frames of two points each: 30 s² / n + 8/7 Σ_g (Σ r)² / n² + .3²."""
    by_frame = np.array([1, -1, 1, -1, 1, -1, 1, -1.0])
    off_px, frames = by_frame.repeat(2), np.arange(8).repeat(2)
    fit = CameraFit(np.array([0.5]), frames, np.ones(16), off_px, np.ones((16, 1)))
    expected = 30 / 16 + 8 / 7 * 8 * 2**2 / 16**2 + 0.3**2
    np.testing.assert_allclose(covariance(fit), [[expected]], rtol=1e-6)
    precise = fit._replace(slopes=100 * fit.slopes)
    found = FoundCamera(precise, Agreement(0.8, 0.2, 0.9), np.array([[0.5], [0.52]]))
    half = 1.894579 * np.sqrt(expected / 100**2 + 0.02**2 / 2)  # Student's t of 8 stretches
    np.testing.assert_allclose(half_widths(found), [half], rtol=1e-6)


def test_ends_that_are_about_as_good_count_once_each():
    """Of the best, which is the camera, so that another one counts by half."""
    fit = CameraFit(np.array([0.5]), np.zeros(1, int), np.ones(1), np.zeros(1), np.ones((1, 1)))

    def ended(at: float, on_edges: float) -> End:
        return End(Agreement(on_edges, 0.2, 1.0), fit._replace(unit=np.array([at])))

    found = best_end([ended(0.9, 0.6), ended(0.52, 0.75), ended(0.5, 0.8)])
    assert found.fit.unit == 0.5
    assert found.ends.tolist() == [[0.52], [0.5]]
    nowhere = best_end([ended(0.3, 0.1), ended(0.4, 0.2)])
    assert nowhere.ends.tolist() == [nowhere.fit.unit.tolist()]


def found_at(unit: np.ndarray) -> FoundCamera:
    """A camera whose parameters are each told by 160 points alone, to a pixel."""
    frames, off_px = np.arange(8).repeat(120), np.tile([1.0, -1.0], 480)
    slopes = 100 * np.tile(np.eye(6), (160, 1))
    fit = CameraFit(unit, frames, np.ones(960), off_px, slopes)
    return FoundCamera(fit, Agreement(0.8, 0.2, 0.9), unit[None])


def test_what_is_written_is_the_camera_in_a_tuning_file(filmed, tmp_path):
    found = found_at(filmed.truth)
    result = describe(filmed.task, found, FRAMES)
    json.dumps(result)
    assert result["parameters"]["camera_x"]["mean"] == pytest.approx(0.1 + 0.6 * (0.6 - 0.5))
    low = result["parameters"]["camera_x"]["low"]
    reach = 0.6 * half_widths(found)[0]
    assert low == pytest.approx(result["parameters"]["camera_x"]["mean"] - reach, rel=1e-6)
    assert result["warnings"] == []
    text = TUNING[: TUNING.index("[camera]")] + tuning_table(result)
    text += TUNING[TUNING.index("[[sensors]]") :]
    (tmp_path / "found.toml").write_text(text)
    model = load_task(str(tmp_path / "found.toml")).load_model()
    camera = model.camera(filmed.task.cameras[0].camera)
    np.testing.assert_allclose(camera.pos, result["position_m"])
    np.testing.assert_allclose(camera.quat, result["quat"], atol=1e-9)


def test_what_is_written_of_a_region_is_the_whole_picture_s_camera(task, options, tmp_path):
    region = "region = { left = 10, top = 5, right = 50, bottom = 40, width = 64, height = 64 }"
    text = TUNING.replace("field_of_view_deg = 50", f"field_of_view_deg = 50\n{region}")
    (tmp_path / "tune.toml").write_text(text)
    part = with_any_camera(loaded := load_task(task.source), loaded.cameras[0], options)
    table = tuning_table(describe(part, found_at(np.full(6, 0.5)), FRAMES))
    assert "field_of_view_deg = 50.0\n" in table  # of the whole picture, too
    whole = load_task(str(tmp_path / "tune.toml")).load_model().camera("simtune_camera")
    again = text[: text.index("[camera]")] + table + f"{region}\n"
    (tmp_path / "tune.toml").write_text(again + text[text.index("[[sensors]]") :])
    found = load_task(str(tmp_path / "tune.toml")).load_model().camera("simtune_camera")
    np.testing.assert_allclose(found.quat, whole.quat, atol=1e-6)
    np.testing.assert_allclose(found.fovy, whole.fovy, atol=1e-6)
    with pytest.raises(InputError, match="--within-fov-deg goes with a camera without lens"):
        with_any_camera(loaded, loaded.cameras[0], replace(options, within_fov_deg=5.0))


def test_a_camera_at_the_end_of_its_range_is_warned_of(filmed):
    result = describe(filmed.task, found_at(np.array([1.0, 0.5, 0.5, 0.5, 0.5, 0.5])), 9)
    (said,) = result["warnings"]
    assert said.startswith("camera_x is at the end of what was searched")


@pytest.mark.parametrize(("agreement", "is_found"), [(0.8, True), (0.25, False)])
def test_a_camera_that_is_not_found_is_not_written(
    filmed, tmp_path, monkeypatch, agreement, is_found
):
    found = found_at(filmed.truth)._replace(agreement=Agreement(agreement, 0.2, 0.9))
    real, path = tmp_path / "real", tmp_path / "camera.toml"
    seen = observed(filmed.task, None, is_simulated=False)
    collected = SimpleNamespace(collect=lambda _: [], observation=seen)
    monkeypatch.setattr(find, "open_recordings", lambda *_: SimpleNamespace(aspects=[1.0]))
    monkeypatch.setattr(find, "RecordedReal", lambda *_: collected)
    monkeypatch.setattr(find, "find_pose", lambda task, *_: describe(task, found, FRAMES))
    result = find_camera_pose(CheckConfig(task=filmed.task.source, real=real, camera_pose=path))
    assert path.exists() == is_found
    last = f"written to {path}" if is_found else f"not found: nothing is written to {path}"
    assert lines(result, path)[-1] == last


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera_pose": None, "within_m": 2.0}, "--within-m goes with --camera-pose only"),
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


def test_without_joints_there_is_no_pose(options, tmp_path):
    task = load_task("rope_peg")
    with pytest.raises(InputError, match=r"declare \[\[sensors\]\]"):
        with_any_camera(task, task.cameras[0], options)
    # Built-in tasks have encoders, which are looked at if that is asked for.
    asked = replace(options, task="cartpole", real=tmp_path, camera_pose=tmp_path / "camera.toml")
    with pytest.raises(InputError, match=r"--observe cameras,joints"):
        find_camera_pose(asked)


def test_a_pose_is_written_whole_and_as_utf_8_whatever_the_locale(tmp_path, monkeypatch):
    monkeypatch.setattr("io.text_encoding", lambda encoding, *_: encoding or "ascii")
    needed = ("load_task", "replace", "with_any_camera", "open_recordings", "RecordedReal")
    for name in needed:
        monkeypatch.setattr(find, name, MagicMock())
    monkeypatch.setattr(find, "observed", lambda *_, **__: MagicMock(cameras=[MagicMock()]))
    monkeypatch.setattr(find, "find_pose", lambda *_: {"is_found": True})
    monkeypatch.setattr(find, "tuning_table", lambda _: "# within 2°\n")
    path = tmp_path / "camera.toml"
    find_camera_pose(CheckConfig(task="cartpole", real=tmp_path, camera_pose=path))
    assert path.read_text(encoding="utf-8") == "# within 2°\n"
    assert [file.name for file in tmp_path.iterdir()] == ["camera.toml"]


@pytest.mark.slow
def test_check_finds_where_the_camera_is(task, filmed, tmp_path, monkeypatch, capsys):
    """From 10 cm and 8° off, of a robot in other colours than the model's."""
    seen = observed(filmed.task, None, is_simulated=True)
    rng = np.random.default_rng(1)
    world = filmed.space.from_unit(filmed.truth)[None]
    simulator = filmed.painted.simulator(image_size=SIZE, supersampling=2)
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
    truth = dict(zip(filmed.space.names, world[0], strict=True))
    its = result["parameters"].items()
    assert sum(found["low"] <= truth[name] <= found["high"] for name, found in its) >= 5  # of 6
    off_m = [result["position_m"][i] - truth[f"camera_{axis}"] for i, axis in enumerate("xyz")]
    assert np.linalg.norm(off_m) < 0.02, off_m
    assert (tmp_path / "camera.toml").read_text() == tuning_table(result)
