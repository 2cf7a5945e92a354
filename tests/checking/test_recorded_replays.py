"""Replays of recordings in `check` are set up as a fit's: objects untouched, motors that ran."""

from pathlib import Path

import numpy as np
import pytest

from simtune.checking.sensitivity.parameters import one_by_one
from simtune.checking.sensitivity.reading_changes import ReadingChanges, ReplayedReadings
from simtune.fit.readings.readings import Readings
from simtune.real.observed import observed
from simtune.tasks import Task, load_task

PUSHER = """
<mujoco>
  <option timestep=".005" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="2 2 .1" friction=".01"/>
    <body pos="-.2 0 .05">
      <joint name="slider" type="slide" axis="1 0 0"/>
      <geom type="box" size=".02 .04 .02" mass="1" friction=".01"/>
    </body>
    <body name="box" pos="0 0 .03"><freejoint name="box"/>
      <geom name="box" type="box" size=".03 .03 .03" mass=".3"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="slider" kp="200" kv="20"/></actuator>
</mujoco>
"""
PUSHES = """
model = "scene.xml"
control_timestep_s = 0.02
[initial_state]
kind = "distribution"
[initial_state.joints]
box = { position = [[-0.05, 0.05], [-0.01, 0.01], [0.03, 0.03]] }
[[sensors]]
name = "encoder"
joints = "slider"
noise = 0.0005
[[parameters]]
name = "kp"
kind = "gain"
objects = "servo"
[[parameters]]
name = "box_mass"
kind = "mass"
objects = "box"
"""
LIFT = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body><joint name="lift" type="slide" axis="0 0 1" damping=".5"/>
    <geom size=".1" mass="1"/></body></worldbody>
  <actuator><motor name="fan" joint="lift" gear="20"/></actuator>
</mujoco>
"""
HOVERS = """
model = "scene.xml"
control_timestep_s = 0.02
[[sensors]]
name = "height"
joints = "lift"
noise = 0.0005
[[parameters]]
name = "thrust"
kind = "gain"
objects = "fan"
[[parameters]]
name = "lag"
kind = "lag"
objects = "fan"
nominal = 0.06
"""


def made(folder: Path, scene: str, tune: str) -> Task:
    (folder / "scene.xml").write_text(scene)
    (folder / "tune.toml").write_text(tune)
    return load_task(str(folder / "tune.toml"))


def episodes(task: Task, actions: np.ndarray, seed: int = 3) -> Readings:
    """Of (E, T, 1) actions in nominal worlds, the first joint read without noise."""
    worlds = np.tile(task.parameters.nominal, (len(actions), 1))
    simulator = task.simulator(image_size=16)
    played = simulator.roll_out(worlds, actions, np.random.default_rng(seed))
    return Readings(actions, simulator.state_space.positions_and_velocities(played.states)[..., :1])


def told(task: Task, readings: Readings) -> ReadingChanges:
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    nominal = task.parameters.nominal
    replays = ReplayedReadings(simulator, seen, nominal, readings.actions, readings)
    return replays.changes(one_by_one(task.parameters, nominal), np.array([5e-4]))


def test_an_object_that_begins_anywhere_is_touched_in_no_replay(tmp_path):
    """Nothing says where it was: fits to readings leave it out, and cannot tell its mass."""
    task = made(tmp_path, PUSHER, PUSHES)
    times = np.arange(60) * 0.02
    pushes = 0.1 + 0.12 * np.sin(times * np.array([[4], [5], [6], [7]]) - 1)
    found = told(task, episodes(task, pushes[..., None]))
    assert found.changes.tolist() == [True, False]


@pytest.mark.thorough
def test_motors_that_ran_before_are_not_off_where_a_flight_is_cut(tmp_path):
    """Else each would begin with a fall that tells its motor's lag: by 16 cm instead of 3."""
    task = made(tmp_path, LIFT, HOVERS)
    times = 0.02 * np.arange(150)
    actions = 0.49 + 0.1 * np.sin([3 * times, 5 * times])[..., None]  # it nearly hovers
    flight = episodes(task, actions)
    found = told(task, Readings(flight.actions[:, 37:], flight.values[:, 37:]))
    thrust_m, lag_m = found.largest[:, 0]
    assert thrust_m > 3
    assert 0.01 < lag_m < 0.05
