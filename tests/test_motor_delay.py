"""Recordings of motors whose commands take effect late, and which were off before."""

import mujoco
import numpy as np

from simtune.fit import OpenLoopReplay, Readings
from simtune.fit.readings.whole_episodes import replay_whole
from simtune.real.observed import observed
from simtune.tasks import load_task

STEPS, LATE = 30, 2
SCENE = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <body name="wheel"><joint name="wheel" axis="0 0 1" damping=".001" armature=".001"/>
      <geom type="sphere" size=".03" mass=".1"/>
    </body>
  </worldbody>
  <actuator><velocity name="motor" joint="wheel" kv=".02"/></actuator>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.04
episode_steps = 30

[[sensors]]
name = "wheel"
joints = "wheel"
noise = 0.001
offset = 0

[[parameters]]
name = "kv"
kind = "gain"
objects = "motor"
"""


def test_a_late_motor_is_replayed_from_where_its_commands_take_effect(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, values = mujoco.MjData(model), np.zeros((1, STEPS + 1, 1))
    actions = np.random.default_rng(0).uniform(5, 10, (1, STEPS, 1))
    for t in range(STEPS):
        data.ctrl[:] = actions[0, t - LATE] if t >= LATE else 0.0
        mujoco.mj_step(model, data, 20)
        values[0, t + 1] = data.qpos
    late = Readings(actions, values).delayed(LATE)
    loop = OpenLoopReplay.of(simulator, seen, task.parameters.nominal)
    unit = task.parameters.to_unit(task.parameters.nominal)
    left = replay_whole(loop, late, unit, np.zeros(1)) - late.values
    assert np.isfinite(left).sum() == STEPS + 1 - LATE
    assert np.nanmax(np.abs(left)) < 1e-4  # the speed at the start is as read
    assert values.max() > 1


def test_actions_are_beside_the_readings_that_they_take_effect_at():
    actions, values = np.arange(5.0)[None, :, None], np.arange(10.0, 16)[None, :, None]
    late = Readings(actions, values).delayed(2)
    np.testing.assert_array_equal(late.actions, actions)
    np.testing.assert_array_equal(late.values[0, :, 0], [12, 13, 14, 15, np.nan, np.nan])
    np.testing.assert_array_equal(Readings(actions, values).delayed(0).values, values)
