"""Recordings of motors whose commands take effect late, and which were off before."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.before_after.readings import Tuned, replay
from simtune.evaluation.replay import better_in, only_early
from simtune.fit import Readings
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.whole_episodes import replay_whole
from simtune.real.observed import observed
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory

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
high = 1000
"""


def write(folder: Path) -> Task:
    (folder / "scene.xml").write_text(SCENE)
    (folder / "tune.toml").write_text(TUNE)
    return load_task(str(folder / "tune.toml"))


def late_wheel(speed: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(1, T, 1) actions and (1, T + 1, 1) angles of a wheel that turns at a speed at first."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, values = mujoco.MjData(model), np.zeros((1, STEPS + 1, 1))
    data.qvel[:] = speed
    actions = np.random.default_rng(0).uniform(5, 10, (1, STEPS, 1))
    for t in range(STEPS):
        data.ctrl[:] = actions[0, t - LATE] if t >= LATE else 0.0
        mujoco.mj_step(model, data, 20)
        values[0, t + 1] = data.qpos
    return actions, values


def test_a_late_motor_is_replayed_from_where_its_commands_take_effect(tmp_path):
    task, (actions, values) = write(tmp_path), late_wheel()
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    late = Readings(actions, values).delayed(LATE)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
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
    assert np.isnan(Readings(actions, values).delayed(9).values).all()  # longer than these


def test_what_comes_before_late_actions_is_neither_replayed_nor_scored(tmp_path):
    """It turns at first, which no command explains."""
    task, (actions, values) = write(tmp_path), late_wheel(speed=-5.0)
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    frames = np.zeros((STEPS + 1, 0, 0, 3), np.uint8)
    episode = Trajectory(frames, actions[0].astype(np.float32), 0.04, {"wheel": values[0]})
    nominal = task.parameters.nominal
    found = replay(simulator, seen, [episode], nominal, Tuned(nominal, {}, latency_steps=LATE))
    assert np.isnan(found.after[0, :LATE]).all()
    np.testing.assert_allclose(found.after[0, LATE:], values[0, LATE:], atol=1e-3)
    scores = found.scores()["wheel"]
    assert scores["rms"] < 1e-3 < scores["rms_before"]
    assert better_in(found) == {"wheel": 1}
    longer = Tuned(nominal, {}, latency_steps=STEPS + 5)  # than the episode
    assert np.isnan(replay(simulator, seen, [episode], nominal, longer).after).all()


@pytest.mark.filterwarnings("error")  # numpy's on means of nothing
def test_a_replay_that_diverges_is_counted_not_scored(tmp_path):
    """Before tuning, so stiff a motor is unstable at the model's timestep."""
    task, (actions, values) = write(tmp_path), late_wheel()
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    frames = np.zeros((STEPS + 1, 0, 0, 3), np.uint8)
    episode = Trajectory(frames, actions[0].astype(np.float32), 0.04, {"wheel": values[0]})
    nominal, stiff = task.parameters.nominal, task.parameters.nominal * 1e4
    found = replay(simulator, seen, [episode], stiff, Tuned(nominal, {}, latency_steps=LATE))
    assert (found.diverged_before, found.diverged) == ((0,), ())
    its = found.scores()["wheel"]
    assert its["rms_before"] is None
    assert its["rms"] < 1e-3
    assert its["diverged_before"] == 1
    assert "diverged" not in its
    assert better_in(found) == {"wheel": 1}
    assert np.isnan(found.curves()["sensors"]["wheel"]["before"]).all()
    lost = replay(simulator, seen, [episode], nominal, Tuned(stiff, {"wheel": 0.1}))
    assert (lost.diverged_before, lost.diverged) == ((), (0,))
    assert lost.scores()["wheel"]["rms"] is None
    assert better_in(lost) == {"wheel": 0}
    assert only_early(lost) == []  # it has another reason
    assert only_early(replace(lost, diverged=())) == ["wheel"]
