"""background = "unknown": what moves, before anything."""

from pathlib import Path

import numpy as np
import pytest

from simtune.before_after.start_search import StartSearchConfig, _Tried, find_start
from simtune.before_after.videos import film_from
from simtune.cameras.views import View
from simtune.checking import check
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.fit.pictures.picture_fit import Pictures, fit_pictures
from simtune.recordings import write_dataset
from simtune.simulation import StrayLight
from simtune.simulation.rendering.backdrops import Backdrops
from simtune.simulation.rendering.plate import camera_moves
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoints import candidate_keypoints

SIZE = 40
SCENE = """
<mujoco>
  <visual><headlight ambient=".4 .4 .4" diffuse=".5 .5 .5" specular="0 0 0"/></visual>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" rgba=".4 .4 .4 1"/>
    <geom name="post" type="box" size=".1 .1 .3" pos="-.6 .3 .3" rgba="0 1 0 1"/>
    <body name="arm" pos="0 -.9 .9">
      <joint name="turn" type="hinge" axis="0 0 1" damping="1"/>
      <geom name="arm" type="capsule" size=".03" fromto="0 0 .2 0 .2 .2" mass="1"/>
      <camera name="hand" pos="0 0 0" euler="50 0 0" fovy="60"/>
    </body>
    <body name="ball" pos="0 .1 .2">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom name="ball" size=".2" mass="1"/>
    </body>
  </worldbody>
  <keyframe><key name="home" qpos="0 -.1"/></keyframe>
  <actuator><motor name="push" joint="slide"/><motor name="turn" joint="turn"/></actuator>
</mujoco>
"""
TUNING = """
model = "scene.xml"
control_timestep_s = 0.05
[camera]
camera = "hand"
background = "{}"
[initial_state]
kind = "keyframe"
keyframe = "home"
[[parameters]]
name = "mass"
kind = "mass"
objects = "ball"
[[parameters]]
name = "ball"
kind = "colour"
objects = "ball"
nominal = [0.7, 0.3, 0.2]
"""


def load(folder: Path, background: str = "unknown") -> Task:
    (folder / "scene.xml").write_text(SCENE)
    (folder / "tune.toml").write_text(TUNING.format(background))
    task = load_task(str(folder / "tune.toml"))
    assert isinstance(task, Task)
    return task


@pytest.fixture(scope="module")
def task(tmp_path_factory) -> Task:
    return load(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def simulator(task):
    view = View("hand", 1.25, background_is_unknown=True)
    return task.simulator(image_size=SIZE, supersampling=2, views=[view])


@pytest.fixture(scope="module")
def states(task, simulator):
    """(9, S) of an episode in which both move."""
    world, actions = task.parameters.nominal[None], np.full((1, 8, 2), [2.0, 0.6])
    return simulator.roll_out(world, actions, np.random.default_rng(0)).states[0]


def rooms(num: int, seed: int) -> StrayLight:
    """Without shadows and reflections."""
    backdrop = np.random.default_rng(seed).integers(1, 1000, num)
    return StrayLight.none(num)._replace(backdrop=backdrop)


def worlds(task: Task, num: int) -> np.ndarray:
    return np.tile(task.parameters.nominal, (num, 1))


def test_a_number_is_a_picture_and_no_two_are_alike():
    backdrops = Backdrops((24, 32))
    pictures = backdrops.of(np.arange(1, 101))
    assert pictures.shape == (100, 24, 32, 3)
    np.testing.assert_array_equal(Backdrops((24, 32)).of(np.array([7])), pictures[6:7])
    assert len(np.unique(pictures.reshape(100, -1), axis=0)) == 100
    assert 40 < pictures.mean((1, 2)).std() < 90  # of all colours
    spread = pictures.std((1, 2)).mean(1)
    assert spread.min() < 5  # some are empty
    assert np.median(spread) > 15


def test_what_moves_is_drawn_before_other_pictures_and_all_else_is_not(task, simulator, states):
    num = len(states)
    one, other = (simulator.render(states, worlds(task, num), rooms(num, k)) for k in (1, 2))
    plain = simulator.render(states, worlds(task, num))
    covered = simulator.covers(states, worlds(task, num))
    ball = (plain[..., 0] > 1.5 * plain[..., 1]) & covered
    np.testing.assert_array_equal(covered, ball)  # neither floor nor post, and no arm is seen
    assert 0.02 < covered.mean() < 0.4
    np.testing.assert_array_equal(one[covered], plain[covered])
    np.testing.assert_array_equal(other[covered], plain[covered])
    near = np.abs(one.astype(int) - other).max(-1) > 0
    assert near[~covered].mean() > 0.9
    assert (plain[:, :8] == 128).all()


def test_frames_of_an_episode_have_other_backgrounds(simulator, task, states):
    stray = rooms(2, 3).in_frames(5)
    assert len(np.unique(stray.backdrop)) == 10
    np.testing.assert_array_equal(stray.shadow, np.zeros(10))
    again = simulator.render(states[[0] * 10], worlds(task, 10), stray)
    assert len(np.unique(again.reshape(10, -1), axis=0)) == 10


def test_colours_are_fitted_to_what_is_drawn_whatever_is_behind(task, simulator, states):
    """By a camera of usual response, whose film has noise."""
    truth = task.parameters.nominal
    frames = simulator.render(states, worlds(task, len(states)), rooms(len(states), 4))
    noise = np.random.default_rng(5).normal(0, 2, frames.shape)
    frames = np.rint(frames + noise).clip(0, 255).astype(np.uint8)
    pictures = Pictures(frames=frames, full_states=states, camera_noise=ImageNoise())
    start = truth.copy()
    start[1:] = 0.5
    found = fit_pictures(simulator, pictures, start, np.arange(1, 4))
    np.testing.assert_allclose(found.unit, truth[1:], atol=0.01)
    plain = task.simulator(image_size=SIZE, supersampling=2, views=[View("hand", 1.25)])
    misled = fit_pictures(plain, pictures, start, np.arange(1, 4))  # edges mix with a grey floor
    assert np.abs(misled.unit - truth[1:]).max() > 3 * np.abs(found.unit - truth[1:]).max()


def test_the_report_shows_what_is_drawn_over_the_real_film(task, simulator, states):
    rng, actions = np.random.default_rng(6), np.zeros((8, 2), np.float32)
    frames = rng.integers(0, 256, (9, *simulator.shape, 3)).astype(np.uint8)
    real = Trajectory(frames, actions, simulator.step_s)
    shown = film_from(simulator, real, task.parameters.nominal, states[0])
    played = simulator.roll_out(worlds(task, 1), actions[None], rng, starts=states[:1]).states[0]
    covered = simulator.covers(played, worlds(task, 9))
    np.testing.assert_array_equal(shown[~covered], frames[~covered])
    drawn = simulator.render(played, worlds(task, 9))
    np.testing.assert_array_equal(shown[covered], drawn[covered])


def test_what_stands_still_is_no_keypoint(simulator):
    model = simulator.model
    seen = [View("hand"), View("hand", background_is_unknown=True)]
    keypoints = candidate_keypoints(model, seen, SIZE)
    names = [
        {model.geom(geom).name for geom in keypoints.geoms[keypoints.views == view]}
        for view in range(2)
    ]
    assert names == [{"post", "ball"}, {"ball"}]


def test_only_a_background_that_is_one_picture_needs_a_camera_that_stands(tmp_path, task):
    model = task.load_model()
    assert camera_moves(model, "hand")
    assert task.cameras[0].plate([], (SIZE, SIZE)) is None
    recorded = load(tmp_path, "recording")
    picture = np.zeros((SIZE, SIZE, 3), np.uint8)
    with pytest.raises(InputError, match=r'moves, .* say background = "unknown"'):
        recorded.simulator(image_size=SIZE, views=[View("hand", 1.0, picture)])
    with pytest.raises(InputError, match='"recording" or "unknown"'):
        load(tmp_path, "anything")


@pytest.mark.thorough
def test_check_names_an_unknown_background_unless_it_is_declared(tmp_path, small_library):
    """A film in which nothing moves: whatever is wrong with it, it is not of this scene."""
    frames = np.full((31, 40, 50, 3), 90, np.uint8)
    frames[:, 10:30, 10:30] = 200
    actions = np.outer(np.cos(np.arange(30) / 8), [3.0, 0.3]).astype(np.float32)
    film = [Trajectory(frames, actions, 0.05)]
    write_dataset(tmp_path / "real", film, action_names=["push", "turn"], robot_type="", task="")
    for background, is_named in ((None, True), ("unknown", False)):
        folder = tmp_path / str(background)
        folder.mkdir()
        load(folder, "unknown")
        tuning = folder / "tune.toml"
        if background is None:
            tuning.write_text(tuning.read_text().replace('background = "unknown"\n', ""))
        pictures = folder / "seen.png"
        asked = CheckConfig(task=str(tuning), real=str(tmp_path / "real"), pictures=pictures)
        (warning,) = check(asked)["warnings"]
        assert "film" in warning
        assert ('say background = "unknown"' in warning) == is_named


def test_a_start_out_of_the_picture_is_not_the_nearest_one(tmp_path):
    load(tmp_path)
    anywhere = 'kind = "distribution"\njoints = { slide = { position = [-4, 4] } }'
    text = TUNING.format("unknown").replace('kind = "keyframe"', anywhere)
    (tmp_path / "tune.toml").write_text(text)
    task = load_task(str(tmp_path / "tune.toml"))
    view = View("hand", 1.25, background_is_unknown=True)
    simulator = task.simulator(image_size=24, views=[view])
    world, still = task.parameters.nominal, np.zeros((4, 2), np.float32)
    start = simulator.begin(world[None], np.random.default_rng(0)).states[:, 0]
    start[0, 1:3] = 0.0, 0.2  # after the time
    states = simulator.roll_out(world[None], still[None], None, starts=start).states[0]
    film = Trajectory(simulator.render(states, worlds(task, 5), rooms(5, 3)), still, 0.05)
    config = StartSearchConfig(num_starts=32, rounds=3)
    found = find_start(simulator, film, world, np.random.default_rng(1), config)
    assert simulator.covers(found[None], world[None]).any()
    assert found[2] == pytest.approx(0.2, abs=0.1)


def test_of_starts_that_hardly_show_anything_none_is_near_unless_that_is_so_of_all():
    starts, squares = np.arange(4.0)[:, None], np.array([0.0, 8.0, 900.0, 400.0])
    tried = _Tried(starts, squares, np.array([0, 4, 100, 100]))
    np.testing.assert_array_equal(tried.distance, [np.inf, np.inf, 9, 4])
    np.testing.assert_array_equal(tried.nearest(8).starts, [[3], [2]])
    unseen = _Tried(starts, np.zeros(4), np.zeros(4, int))
    np.testing.assert_array_equal(unseen.distance, np.zeros(4))
    assert len(unseen.joined(tried).nearest(3).starts) == 2
