"""Several cameras of any shape, side by side: drawn, seen, recorded and read again."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from mujoco.batch import Batch

from simtune.cameras.footage import Footage
from simtune.cameras.views import View, apart
from simtune.checking import check
from simtune.config import CheckConfig, RecordConfig, TuneConfig
from simtune.errors import InputError
from simtune.filming import record
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace, colour
from simtune.randomization import Distribution
from simtune.real.choose import choose_real
from simtune.real.observed import observed
from simtune.real.recorded import RecordedReal
from simtune.recordings import open_dataset, write_dataset
from simtune.simulation import PictureSettings, Simulator
from simtune.simulation.rendering.primitives.drawing import Primitives
from simtune.simulation.rendering.renderer import make_renderer
from simtune.tasks import Task, load_task, with_one_square_camera
from simtune.trajectory import Trajectory
from simtune.vision.detector import DetectorConfig, KeypointDetector, detect, to_input
from simtune.vision.keypoints import Keypoints, candidate_keypoints, find_keypoints

HEIGHT = 48
MODEL = """
<mujoco>
  <option gravity="0 0 0"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1" fovy="40"/>
    <camera name="top" pos="0 0 2.5" fovy="40"/>
    <geom name="floor" type="plane" size="5 5 .1" pos="0 0 -1" rgba="0 0 0 1"/>
    <geom name="post" type="box" size=".05 .05 .3" pos=".3 0 .3" rgba="0 0 1 1"/>
    <body name="ball">
      <joint name="x" type="slide" axis="1 0 0" damping="1"/>
      <joint name="z" type="slide" axis="0 0 1" damping="1"/>
      <geom name="ball" type="sphere" size=".05" mass="1" rgba="1 0 0 1"/>
      <camera name="hand" pos="0 -.5 0" xyaxes="1 0 0 0 0 1" fovy="100"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="x" gear="1" ctrlrange="-1 1"/>
    <motor joint="z" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
TUNING = """
model = "scene.xml"
control_timestep_s = 0.05
episode_steps = 12

[[cameras]]
name = "front"
key = "observation.images.front"

[[cameras]]
name = "above"
key = "observation.images.above"
camera = "top"

[[parameters]]
name = "mass"
kind = "mass"
objects = "ball"
"""
SPACE = ParameterSpace(colour("ball", ("ball",), (1.0, 0.0, 0.0)))


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


@pytest.fixture
def task(tmp_path) -> Task:
    (tmp_path / "scene.xml").write_text(MODEL)
    (tmp_path / "tune.toml").write_text(TUNING)
    return load_task(str(tmp_path / "tune.toml"))


def poses(model: mujoco.MjModel, num: int) -> Batch:
    batch, rng = Batch(model, num), np.random.default_rng(0)
    for field in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat"):
        batch.bind(field)
    batch.reset()
    batch.qpos[:] = rng.uniform([-0.25, 0.15], [0.15, 0.6], (num, 2))
    batch.forward()
    return batch


def centroids(frames: np.ndarray, channel: int) -> np.ndarray:
    """(n, 2) x, y of the red or the blue thing."""
    colour = frames[..., channel].astype(float) * (frames[..., channel] > 100)
    weight = colour / colour.sum((1, 2), keepdims=True)
    height, width = frames.shape[1:3]
    return np.stack([weight.sum(1) @ np.arange(width), weight.sum(2) @ np.arange(height)], -1)


@pytest.mark.parametrize("aspect", [16 / 9, 0.5])
@pytest.mark.parametrize(
    "renderer", ["raycaster", pytest.param("opengl", marks=pytest.mark.opengl)]
)
def test_keypoints_are_where_each_camera_s_picture_shows_them(model, aspect, renderer):
    batch = poses(model, 5)
    views = [View("front", aspect), View("top", 1.25)]
    keypoints = candidate_keypoints(model, views, HEIGHT)
    assert [model.geom(geom).name for geom in keypoints.geoms] == ["ball", "ball"]
    seen = keypoints.observe(batch).reshape(5, 2, 2)
    left = 0
    for number, view in enumerate(views):
        settings = PictureSettings(image_size=HEIGHT, renderer=renderer)
        try:
            drawer = make_renderer(model, SPACE, view, settings)
        except InputError as error:
            pytest.skip(str(error))
        frames = drawer.render(batch.state, np.tile(SPACE.nominal, (5, 1)))
        assert frames.shape == (5, HEIGHT, view.width(HEIGHT), 3)
        expected = centroids(frames, 0) + np.array([left, 0])
        np.testing.assert_allclose(seen[:, number], expected, atol=0.5)
        left += view.width(HEIGHT)


def test_primitives_are_drawn_in_any_shape_as_mujoco_warp_draws_them(model, monkeypatch):
    batch, worlds = poses(model, 4), np.tile(SPACE.nominal, (4, 1))
    for height, width in ((40, 72), (72, 40)):
        view, settings = View("front", width / height), PictureSettings(image_size=height)
        ours = make_renderer(model, SPACE, view, settings)
        with monkeypatch.context() as patch:
            patch.setattr(Primitives, "can_draw", lambda context: False)
            theirs = make_renderer(model, SPACE, view, settings)
        frames, expected = (r.render(batch.state, worlds) for r in (ours, theirs))
        assert frames.shape == (4, height, width, 3)
        assert np.abs(frames.astype(int) - expected).max() <= 1
        assert len(np.unique(frames.reshape(-1, 3), axis=0)) == 3


def test_what_stands_moves_before_a_camera_on_a_robot(model):
    """And what the camera is mounted on does not."""
    batch = poses(model, 12)
    view = View("hand", 1.5)
    keypoints = candidate_keypoints(model, [view], HEIGHT)
    assert {model.geom(geom).name for geom in keypoints.geoms} == {"post"}  # a floor has no middle
    drawer = make_renderer(model, SPACE, view, PictureSettings(image_size=HEIGHT))
    frames = drawer.render(batch.state, np.tile(SPACE.nominal, (12, 1)))
    inside = (frames[..., 2] > 100).sum((1, 2)) == (frames[:, 1:-1, 1:-1, 2] > 100).sum((1, 2))
    assert inside.sum() >= 4
    middle = keypoints.select([1]).observe(batch)
    np.testing.assert_allclose(middle[inside], centroids(frames, 2)[inside], atol=1.5)


def test_a_simulator_draws_its_views_side_by_side_however_it_samples(task):
    views = [View("front", 1.5), View("top", 0.75)]
    for k in (1, 2):
        both = task.simulator(image_size=HEIGHT, views=views, supersampling=k)
        assert (both.shape, both.widths) == ((HEIGHT, 108), [72, 36])
        rng = np.random.default_rng(0)
        rollouts = both.roll_out(task.parameters.nominal[None], np.ones((1, 3, 2)), rng)
        frames = both.film(rollouts)
        assert frames.shape == (1, 4, HEIGHT, 108, 3)
        for view, seen in zip(views, apart(frames, both.widths), strict=True):
            alone = task.simulator(image_size=HEIGHT, views=[view], supersampling=k)
            np.testing.assert_array_equal(alone.film(rollouts), seen)


def test_a_detector_finds_what_is_in_a_wide_picture():
    """Each cell's own position is what a heatmap that peaks there says."""
    detector = KeypointDetector(1, 0, (16, 40), DetectorConfig(channels=4, free_maps=2))
    assert detector.cells == (8, 20)
    heatmap = np.full((1, 1, 160), -20, np.float32)
    heatmap[0, 0, 3 * 20 + 17] = 20  # row 3, column 17
    places, *_ = detector.candidates(torch.tensor(heatmap))
    np.testing.assert_allclose(places[0, 0], [[17 * 2 + 0.5, 3 * 2 + 0.5]], atol=1e-4)
    frames = np.zeros((2, 16, 40, 3), np.uint8)
    assert to_input(frames).shape == (2, 3, 16, 40)
    assert detect(detector, frames).keypoints.shape == (2, 1, 2)


def test_each_camera_has_noise_of_its_own(task):
    seen = ObservationModel.of_reality(films=task.cameras)
    simulator = task.simulator(image_size=16, views=seen.views())
    frames = np.full((1, 400, 16, 32, 3), 120, np.uint8)
    seen.add_noise(simulator, frames, np.random.default_rng(0))
    left, right = apart(frames.mean((0, 1, 2))[None], [16, 16])
    assert abs(left.mean() - right.mean()) > 2
    assert left[..., 0].std() < 0.5


def test_what_two_cameras_film_is_recorded_and_read_again(task, tmp_path):
    seen, simulator = observed(task, None, is_simulated=True), task.simulator(image_size=HEIGHT)
    rng = np.random.default_rng(0)
    rollouts = simulator.roll_out(task.parameters.nominal[None], np.ones((1, 12, 2)), rng)
    (filmed,) = seen.record(simulator, rollouts, rng)
    write_dataset(
        tmp_path / "data",
        [filmed],
        action_names=["x", "z"],
        robot_type="sim",
        task="t",
        widths={"front": HEIGHT, "above": HEIGHT},
    )
    read = open_dataset(tmp_path / "data", cameras=task.cameras, image_size=HEIGHT).read(0).frames
    assert read.shape == (13, HEIGHT, 2 * HEIGHT, 3)
    for video, drawn in zip(
        *(apart(frames, [HEIGHT, HEIGHT]) for frames in (read, filmed.frames)), strict=True
    ):
        assert np.abs(video.astype(int) - drawn).mean() < 4
        np.testing.assert_allclose(centroids(video, 0), centroids(drawn, 0), atol=0.5)


def test_record_films_with_every_camera(task, tmp_path):
    config = RecordConfig(task=task.source, out=tmp_path / "data", episodes=1, image_size=HEIGHT)
    dataset = open_dataset(record(config), cameras=task.cameras)
    assert dataset.read(0).frames.shape == (13, HEIGHT, 2 * HEIGHT, 3)
    keys = [footage.key for footage in task.cameras]
    assert [camera["key"] for camera in dataset.facts(1)["cameras"]] == keys
    assert set(keys) <= set(json.loads((config.out / "meta/stats.json").read_text()))


@pytest.mark.thorough
def test_check_draws_a_picture_of_each_camera(task, tmp_path, monkeypatch, small_library):
    tuning = tmp_path / "tune.toml"
    longer = TUNING.replace("episode_steps = 12", "episode_steps = 21")  # as `tune` needs
    tuning.write_text(longer.replace('"above"', '"left/above"'))
    record(RecordConfig(task=str(tuning), out=tmp_path / "data", episodes=1, image_size=HEIGHT))
    (tmp_path / "temp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temp"))
    monkeypatch.setattr("simtune.checking.film.compare._own_gain", lambda _: 1.0)  # takes longest
    draw = "simtune.checking.recorded.draw_film"
    monkeypatch.setattr(draw, lambda path, *_: path.touch())

    found = check(CheckConfig(task=str(tuning), real=tmp_path / "data"))
    pictures = sorted((tmp_path / "temp").iterdir())
    assert sorted(Path(film["pictures"]) for film in found["films"].values()) == pictures
    named = sorted(path.name.split("-", 3)[-1] for path in pictures)
    assert named == ["front.png", "left_above.png"]


def filmed(folder, sizes: dict[str, tuple[int, int]], num: int = 20):
    """A dataset whose frame t is as bright as 10 t, in pictures of these sizes."""
    height = max(h for h, _ in sizes.values())
    level = (10 * np.arange(num, dtype=np.uint8))[:, None, None, None]
    frames = np.broadcast_to(level, (num, height, sum(w for _, w in sizes.values()), 3)).copy()
    write_dataset(
        folder,
        [Trajectory(frames, np.zeros((num - 1, 1), np.float32), 0.1)],
        action_names=["a"],
        robot_type="sim",
        task="t",
        widths={name: width for name, (_, width) in sizes.items()},
    )
    return folder


def test_views_are_of_the_aspects_that_recordings_have(tmp_path):
    path = filmed(tmp_path / "data", {"wide": (32, 64), "upright": (32, 16)})
    cameras = [Footage(camera=name, name=name, key=name) for name in ("upright", "wide")]
    dataset = open_dataset(path, cameras=cameras, image_size=16)
    assert dataset.aspects == [0.5, 2.0]
    assert dataset.read(0).frames.shape == (20, 16, 8 + 32, 3)
    real = ObservationModel.of_reality(films=cameras).framed(dataset.aspects)
    assert [view.width(16) for view in real.views()] == [8, 32]
    (frames,) = {t.frames.shape for t in RecordedReal(dataset, real).collect()}
    assert frames == (20, 16, 40, 3)


def test_a_camera_s_frames_show_what_was_its_latency_earlier(tmp_path):
    path = filmed(tmp_path / "data", {"one": (16, 16), "other": (16, 16)})
    cameras = [Footage(key="one"), Footage(key="other", latency_s=0.2)]
    frames = open_dataset(path, cameras=cameras).read(0).frames
    one, other = (view.mean((1, 2, 3)) for view in apart(frames, [16, 16]))
    assert len(frames) == 18  # what the last two frames show of it nobody knows
    np.testing.assert_allclose(other - one, 20, atol=2)


def test_cameras_are_observed_by_name(task):
    def names(asked) -> list[str]:
        return [camera.name for camera in observed(task, asked, is_simulated=True).cameras]

    assert names(None) == names(["cameras"]) == ["front", "above"]
    assert names(["above"]) == ["above"]
    with pytest.raises(InputError, match="did you mean 'above'"):
        names(["abov"])


def test_policies_look_through_one_camera(task):
    with pytest.raises(InputError, match="has 2 cameras"):
        with_one_square_camera(task)
    alone = replace(task, cameras=task.cameras[:1])
    assert with_one_square_camera(alone).cameras[0].is_square


def test_keypoints_of_both_views_are_chosen_and_kept(task):
    simulator = task.simulator(image_size=HEIGHT, views=[View("front", 1.5), View("top")])
    assert isinstance(simulator, Simulator)
    first = Distribution.first(task.parameters, task.parameters.nominal)
    chosen = find_keypoints(simulator, first, 0)
    assert isinstance(chosen, Keypoints)
    assert chosen.views.tolist() == [0, 1]
    every = candidate_keypoints(simulator.model, simulator.views, HEIGHT)
    again = every.with_state(json.loads(json.dumps(chosen.state())))
    np.testing.assert_array_equal(again.geoms, chosen.geoms)
    np.testing.assert_array_equal(again.views, chosen.views)


@pytest.fixture
def room(tmp_path) -> np.ndarray:
    """(HEIGHT, HEIGHT, 3) of the picture that the front camera's footage names."""
    from matplotlib.image import imsave

    y, x = np.mgrid[:HEIGHT, :HEIGHT] / HEIGHT
    picture = np.rint(np.stack([60 * y, 90 + 90 * x, 250 - 90 * y], -1)).astype(np.uint8)
    imsave(tmp_path / "room.png", picture)
    (tmp_path / "scene.xml").write_text(MODEL)
    named = 'images.front"\nbackground = "room.png"\n'
    (tmp_path / "tune.toml").write_text(TUNING.replace('images.front"\n', named))
    return picture


def test_a_background_picture_is_behind_pseudo_real_worlds_and_recordings_as_well(tmp_path, room):
    task = str(tmp_path / "tune.toml")
    pseudo, *_ = choose_real(TuneConfig(task=task, out=tmp_path), load_task(task), HEIGHT)
    filming = RecordConfig(task=task, out=tmp_path / "film", episodes=1, image_size=HEIGHT)
    film = open_dataset(
        record(filming), cameras=load_task(task).cameras, image_size=HEIGHT, num_actions=2
    )
    for frames, off in ((pseudo.collect(1)[0].frames, 0), (film.read(0).frames, 12)):
        front, above = apart(frames[0].astype(int), [HEIGHT, HEIGHT])
        is_room = (np.abs(front - room) <= off).all(-1)
        assert 0.8 < is_room.mean() < 1  # the ball is before it
        assert (np.abs(above - room) > 12).any(-1).mean() > 0.9


def test_a_background_picture_is_not_left_out_where_opengl_draws(tmp_path, room):
    task = str(tmp_path / "tune.toml")
    gapped = TuneConfig(task=task, out=tmp_path, real_gap=True)
    with pytest.raises(InputError, match="leave --real-gap or background = FILE out"):
        choose_real(gapped, load_task(task), HEIGHT)
    with pytest.raises(InputError, match=r"room\.png: OpenGL cannot draw a background picture"):
        record(RecordConfig(task=task, out=tmp_path / "film", renderer="opengl"))
    assert not (tmp_path / "film").exists()
