"""Replays of whole episodes begin as the robot did, also if its first readings are missing."""

import numpy as np
import pytest

from simtune.fit import Readings, replay_whole
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.readings import moving_from_the_start, unread_rows
from simtune.observation import ObservationModel
from simtune.tasks import load_task

NOISE_RAD = 1e-3
SCENE = """
<mujoco><option timestep=".005"/>
  <worldbody><body name="arm"><joint name="hinge" axis="0 1 0" damping=".05"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass=".3" contype="0"/></body>
  </worldbody>
  <actuator><motor name="push" joint="hinge" ctrlrange="-1 1"/></actuator>
</mujoco>"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.035
[actions]
mapping = "direct"
[[sensors]]
name = "encoder"
joints = ["hinge"]
noise = 0.001
[[parameters]]
name = "damping"
kind = "damping"
objects = "hinge"
"""


@pytest.fixture(scope="module")
def swung(tmp_path_factory):
    """An arm's replays, its (N,) unit coordinates, and episodes that begin in motion."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "scene.xml").write_text(SCENE)
    (folder / "tune.toml").write_text(TUNE)
    task, rng = load_task(str(folder / "tune.toml")), np.random.default_rng(0)
    simulator, start = task.simulator(image_size=16), task.parameters.nominal
    observation = ObservationModel.of_simulator(task.sensors)
    pushes = rng.uniform(-0.6, 0.6, (4, 12, 1)).repeat(5, 1)
    played = simulator.roll_out(np.tile(start, (4, 1)), pushes, rng, observation.observe_beside())
    read = played.observed + NOISE_RAD * rng.normal(size=played.observed.shape)
    loop = set_up_loop(simulator, observation, start)
    return loop, task.parameters.to_unit(start), Readings(pushes[:, 18:], read[:, 18:])


@pytest.mark.parametrize("unread", [0, 1, 3])
def test_the_start_is_found_from_the_first_readings_that_there_are(swung, unread):
    loop, unit, readings = swung
    speeds = np.diff(readings.values[:, :2, 0], axis=1) / loop.physics.simulator.step_s
    assert np.abs(speeds).max() > 3  # rad/s: a wrong one is far off
    partly = readings.values.copy()
    partly[:, :unread] = np.nan
    predicted = replay_whole(loop, Readings(readings.actions, partly), unit, np.zeros(1))
    errors = predicted - readings.values
    assert np.sqrt(np.square(errors).mean((1, 2))).max() < 1.5 * NOISE_RAD


def test_an_episode_that_is_read_late_does_not_change_where_others_begin(swung):
    loop, unit, readings = swung
    partly = readings.values.copy()
    partly[0, :20] = np.nan
    expected = replay_whole(loop, readings, unit, np.zeros(1))
    predicted = replay_whole(loop, Readings(readings.actions, partly), unit, np.zeros(1))
    np.testing.assert_allclose(predicted[1:], expected[1:], atol=0.1 * NOISE_RAD)
    assert np.isfinite(predicted).all()


def test_what_is_not_read_at_the_start_goes_on_as_it_begins():
    """By hand: 1, 4, 9, 16 after two unread rows; their parabola begins with a slope of 2."""
    rows = np.array([np.nan, np.nan, 1, 4, 9, 16])
    values = np.stack([rows, np.full(6, np.nan), np.arange(6.0)], -1)[None]
    expected = [1 - 2 * 2, 1 - 2, 1, 4, 9, 16]
    np.testing.assert_allclose(moving_from_the_start(values)[0, :, 0], expected)
    np.testing.assert_array_equal(moving_from_the_start(values)[0, :, 1], 0)
    assert unread_rows(values).tolist() == [2]


def test_between_the_readings_of_a_slow_encoder_a_joint_moves_on_a_curve():
    true = np.sin(0.15 * np.arange(60.0))
    read = np.full((1, 60, 2), np.nan)
    read[0, 3::4] = true[3::4, None]
    read[0, 20:40, 1] = np.nan
    whole = moving_from_the_start(read)[0]
    np.testing.assert_allclose(whole[3:, 0], true[3:], atol=5e-3)
    np.testing.assert_allclose(whole[:3, 0], true[:3], atol=0.03)  # as it begins
    line = np.interp(np.arange(19, 44), [19, 43], true[[19, 43]])
    np.testing.assert_allclose(whole[19:44, 1], line)  # a long gap: only that it is bridged
