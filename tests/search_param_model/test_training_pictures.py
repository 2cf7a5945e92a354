"""Pictures to train the detector on: each has its own looks, and loose objects their own places."""

import mujoco
import numpy as np
import pytest
from search_context import CARTPOLE, SIZE, SPACE, START, STEPS, context_of, record_episodes

from simtune.budget import Budget
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.search_param_model.simulated import PlayedWorlds, play_worlds
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.simulation import StateSpace
from simtune.simulation.loose_objects import astray, loose_places, scattered
from simtune.tasks import Task, load_task
from simtune.tuning.world_sampler import WorldSampler
from simtune.vision.keypoints import every_keypoint

FIRST = Distribution.first(SPACE, START)


@pytest.fixture(scope="module")
def played() -> PlayedWorlds:
    context, rng = context_of(CARTPOLE.simulator(image_size=SIZE)), np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (8, 2, STEPS, 1))
    given = context.simulator, context.keypoints, FIRST.sample(8, rng), actions
    return play_worlds(*given, rng, context.observation)


def test_each_picture_has_colours_of_its_own_and_the_rest_from_a_world_that_was_played(played):
    pictures = TrainingPictures.draw(played, FIRST, 100, np.random.default_rng(1))
    look = SPACE.is_appearance
    assert len(np.unique(pictures.parameters[:, look], axis=0)) == 100
    assert ((pictures.parameters >= FIRST.low) & (pictures.parameters <= FIRST.high)).all()
    worlds = {tuple(world) for world in played.parameters[:, ~look]}
    assert {tuple(world) for world in pictures.parameters[:, ~look]} == worlds


def test_pictures_show_what_their_keypoints_and_parameters_say(played):
    pictures = TrainingPictures.draw(played, FIRST, 60, np.random.default_rng(1))
    rollouts = played.rollouts
    points = rollouts.observed[:, :, : 2 * len(played.keypoints)].astype(np.float32)
    moments = set()
    for frame, keypoints, parameters in zip(*vars(pictures).values(), strict=True):
        where = np.argwhere((points == keypoints.ravel()).all(-1))
        assert len(where), "of a step that was played"
        episode, step = where[0]
        moments.add((episode, step))
        drawn = played.simulator.render(rollouts.states[episode, step][None], parameters[None])
        np.testing.assert_array_equal(frame, drawn[0])
    assert len({episode for episode, _ in moments}) > 12, "of any episode"
    assert len({step for _, step in moments}) > 15, "and of any step"


def test_a_sampler_draws_so_many_pictures_for_each_world():
    context = context_of(CARTPOLE.simulator(image_size=SIZE))
    real = record_episodes(CARTPOLE.simulator(image_size=SIZE), 3)
    worlds, pictures = WorldSampler(context).play_and_draw(real, FIRST, 130, 2, 3, Budget())
    assert len(worlds.parameters) == 130
    assert pictures.frames.shape == (390, SIZE, SIZE, 3)
    assert pictures.keypoints.shape == (390, len(context.keypoints), 2)


TWO_THINGS = """
<mujoco>
  <worldbody>
    <body name="arm"><joint name="hinge"/><geom size=".1"/></body>
    <body name="cup" pos="1 2 .3"><freejoint/><geom type="box" size=".1 .1 .2"/></body>
  </worldbody>
</mujoco>
"""


def test_loose_things_are_spread_twice_as_wide_and_turned_and_nothing_else_changes():
    model, rng = mujoco.MjModel.from_xml_string(TWO_THINGS), np.random.default_rng(0)
    space, size = StateSpace(model), mujoco.mjtState.mjSTATE_INTEGRATION
    full_states = rng.normal(size=(4000, mujoco.mj_stateSize(model, size)))
    states = np.zeros((4000, model.nq + model.nv))
    states[:, 0] = rng.normal(size=4000)  # the hinge
    states[:, 1:3] = [1, 2] + rng.uniform(-1, 1, (4000, 2)) * [0.1, 0.3]
    states[:5, 1] = 50.0  # flung away
    states[:, 3] = rng.uniform(0.3, 0.31, 4000)
    tilt = np.array([np.cos(0.2), np.sin(0.2), 0, 0])  # by .4 rad about x
    states[:, 4:8] = tilt
    given = space.with_positions_and_velocities(full_states, states)
    put = scattered(space, given, loose_places(model), 2.0, rng)
    moved = space.positions_and_velocities(put)
    np.testing.assert_array_equal(moved[:, [0, 3, *range(8, 15)]], states[:, [0, 3, *range(8, 15)]])
    rest = np.ones(full_states.shape[1], bool)
    rest[1 : 1 + model.nq + model.nv] = False
    np.testing.assert_array_equal(put[:, rest], full_states[:, rest])
    low, high = moved[:, 1:3].min(0), moved[:, 1:3].max(0)
    np.testing.assert_allclose(low, [1 - 0.2, 2 - 0.6], atol=0.03)
    np.testing.assert_allclose(high, [1 + 0.2, 2 + 0.6], atol=0.03)
    # The box's own upright axis keeps its angle to the vertical, and turns about it.
    w, x, y, z = moved[:, 4:8].T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)], 1)
    np.testing.assert_allclose(axis[:, 2], np.cos(0.4), atol=1e-9)
    heading = np.arctan2(axis[:, 1], axis[:, 0])
    assert np.histogram(heading, 8, (-np.pi, np.pi))[0].min() > 400


def test_a_thing_that_is_pressed_through_the_floor_went_astray():
    model, rng = mujoco.MjModel.from_xml_string(TWO_THINGS), np.random.default_rng(0)
    space, size = StateSpace(model), mujoco.mjtState.mjSTATE_INTEGRATION
    full_states = rng.normal(size=(3, 5, mujoco.mj_stateSize(model, size)))
    states = np.zeros((3, 5, model.nq + model.nv))
    states[..., 0] = 1e3  # the hinge is no loose thing
    states[..., 1:4] = [50, 2, 0.3]  # far from the middle, but where it began
    states[1, :, 1] += np.linspace(0, 1.9 * model.stat.extent, 5)
    states[2, 2:, 3] -= 2.1 * model.stat.extent
    given = space.with_positions_and_velocities(full_states, states)
    assert astray(model, space, given).tolist() == [False, False, True]


PUSHER = """
<mujoco>
  <option timestep=".005"/>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="above" pos="0 0 1" fovy="60"/>
    <geom type="plane" size="2 2 .1" rgba="0 0 1 1"/>
    <body pos="-.3 0 .05">
      <joint name="slider" type="slide" axis="1 0 0"/>
      <geom type="box" size=".02 .04 .02" rgba="0 1 0 1"/>
    </body>
    <body pos="0 0 .03">
      <freejoint name="box"/>
      <geom name="box" type="box" size=".05 .05 .03"/>
    </body>
  </worldbody>
  <actuator><position joint="slider" kp="20" kv="2" ctrlrange="-.02 .02"/></actuator>
</mujoco>
"""
TUNE = """
model = "pusher.xml"
control_timestep_s = 0.02
[camera]
camera = "above"
[initial_state]
kind = "distribution"
[initial_state.joints]
box = { position = [[-0.06, 0.06], [-0.1, 0.1], [0.03, 0.03]] }
[[parameters]]
name = "box"
kind = "colour"
objects = "box"
nominal = [0.8, 0.2, 0.2]
"""


def test_a_loose_box_is_drawn_where_its_keypoints_say(tmp_path):
    (tmp_path / "pusher.xml").write_text(PUSHER)
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    assert isinstance(task, Task)
    simulator, space, rng = task.simulator(image_size=64), task.parameters, np.random.default_rng(0)
    looks, points = Distribution.first(space, space.nominal), every_keypoint(simulator)
    middle = [i for i in range(len(points)) if points.geoms[i] == simulator.model.geom("box").id]
    keypoints = points.select(middle[1:2])
    seen = ObservationModel.of_simulator()
    given = simulator, keypoints, looks.sample(60, rng), np.zeros((60, 1, 10, 1))
    played = play_worlds(*given, rng, seen)
    pictures = TrainingPictures.draw(played, looks, 200, rng)
    red = pictures.frames[..., 0] > 60
    is_red = red.sum((1, 2)) > 20  # in the others it has another colour
    assert is_red.sum() > 100
    at = np.array([np.argwhere(one)[:, ::-1].mean(0) for one in red[is_red]])
    np.testing.assert_allclose(at, pictures.keypoints[is_red, 0], atol=1.0)
    # The task has it within .06 and .1 m of the middle; some worlds have it twice as far away.
    began = simulator.state_space.positions_and_velocities(played.rollouts.states[:, 0])[:, 1:3]
    assert (np.abs(began).max(0) > [0.08, 0.14]).all()
    assert (np.abs(began) < [0.06, 0.1]).all(1).mean() > 0.5
    spans = np.ptp(at, 0) / np.ptp(played.rollouts.observed[..., :2].reshape(-1, 2), 0)
    assert (spans > 0.8).all()


def test_worlds_in_which_a_box_fell_are_not_learnt_from(tmp_path):
    """Without a floor under its half of the places, it falls."""
    floor = '<geom type="plane" size="2 2 .1" rgba="0 0 1 1"/>'
    assert floor in PUSHER
    half = '<geom type="box" pos="1.02 0 -.1" size="1 1 .1"/>'
    (tmp_path / "pusher.xml").write_text(PUSHER.replace(floor, half))
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    assert isinstance(task, Task)
    simulator, rng = task.simulator(image_size=32), np.random.default_rng(0)
    keypoints, space = every_keypoint(simulator), task.parameters
    parameters = Distribution.first(space, space.nominal).sample(40, rng)
    seen, still = ObservationModel.of_reality(), np.zeros((40, 1, 60, 1))
    worlds = play_worlds(simulator, keypoints, parameters, still, rng, seen)
    states = simulator.state_space.positions_and_velocities(worlds.rollouts.states)
    (place,) = loose_places(simulator.model)
    assert 5 < len(worlds.whole) < 35
    assert len(worlds.actions) == len(worlds.parameters) == len(worlds.whole)
    assert (
        np.abs(np.diff(states[..., place + 2], axis=1)).sum(1).max()
        < 2 * simulator.model.stat.extent
    )
