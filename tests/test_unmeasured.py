"""An arm pushes a block that no sensor measures: later segments begin where it was pushed."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.budget import Budget
from simtune.fit import Guess, OpenLoopReplay, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.readings.segments import Segments
from simtune.real.observed import observed
from simtune.tasks import load_task

STEPS, ARM, BLOCK = 60, 0, 1
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="arm"><joint name="arm" type="slide" axis="1 0 0" damping="1"/>
      <geom type="sphere" size=".02" mass=".3"/>
    </body>
    <body name="block" pos=".2 0 0"><joint name="block" type="slide" axis="1 0 0" damping="4"/>
      <geom type="box" size=".02 .05 .05" mass=".1"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="arm" kp="60" kv="6"/></actuator>
  <keyframe><key name="begin" qpos="0 0"/></keyframe>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.04
episode_steps = 60
initial_state = {kind = "keyframe", keyframe = "begin"}

[[sensors]]
name = "place"
joints = "arm"
noise = 0.001

[[parameters]]
name = "kp"
kind = "gain"
objects = "servo"
"""


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> tuple[OpenLoopReplay, Readings, np.ndarray]:
    """A replay, its readings of an arm that pushes twice, and (STEPS + 1,) places of the block."""
    folder: Path = tmp_path_factory.mktemp("pushed")
    (folder / "scene.xml").write_text(SCENE)
    (folder / "tune.toml").write_text(TUNE)
    task = load_task(str(folder / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, places = mujoco.MjData(model), np.zeros((STEPS + 1, 2))
    actions = np.interp(np.arange(STEPS), [5, 25, 35, 50], [0, 0.4, 0.2, 0.5])[:, None]
    for t, data.ctrl[:] in enumerate(actions):
        mujoco.mj_step(model, data, 20)
        places[t + 1] = data.qpos
    loop = OpenLoopReplay.of(simulator, seen, task.parameters.nominal)
    return loop, Readings(actions[None], places[None, :, [ARM]]), places[:, BLOCK]


def unit_of(loop: OpenLoopReplay, kp: float = 60.0) -> np.ndarray:
    space = loop.physics.parameters
    return space.to_unit(space.from_dict({"kp": kp}))


@pytest.mark.parametrize("kp", [60.0, 40.0])
def test_what_is_pushed_goes_along_whatever_the_parameters_are(pushed, kp):
    loop, readings, block = pushed
    unit = unit_of(loop, kp)
    read = loop.carried(loop.states_of(readings, unit, np.zeros(1)), unit)
    assert block[-1] > 0.2
    np.testing.assert_allclose(read.states[0, :, BLOCK], block, atol=0.02)


def test_a_segment_goes_on_from_the_replay_of_the_one_before(pushed):
    loop, readings, block = pushed
    unit, segments = unit_of(loop), Segments.evenly(readings, 20)
    read = loop.states_of(readings, unit, np.zeros(1))
    elsewhere = read._replace(states=read.states + 0.3 * (np.arange(4) == BLOCK))
    parts = elsewhere.cut(segments, goes_on=True)
    states = parts.states.copy()
    states[0, BLOCK] -= 0.3
    predicted, begun = loop.play(parts, states[None], unit[None])
    assert segments.begin.tolist() == [0, 20, 40]
    np.testing.assert_allclose(
        loop.physics.states(begun)[0, :, BLOCK], block[segments.begin], atol=1e-3
    )
    np.testing.assert_allclose(predicted[0], parts.values, atol=2e-3)


def test_segments_of_no_steps_lead_on_without_being_compared(pushed):
    loop, readings, block = pushed
    unit = unit_of(loop)
    segments = Segments(np.zeros(2, int), np.array([0, 35]), np.array([0, 10]))
    parts = loop.states_of(readings, unit, np.zeros(1)).cut(segments, goes_on=True)
    assert np.isfinite(parts.values).sum((1, 2)).tolist() == [0, 11]
    assert parts.actions.shape[1] == 35
    predicted, begun = loop.play(parts, parts.states[None], unit[None])
    np.testing.assert_allclose(loop.physics.states(begun)[0, 1, BLOCK], block[35], atol=1e-3)
    np.testing.assert_allclose(predicted[0, 1, :11], parts.values[1, :11], atol=2e-3)


def test_a_start_is_told_only_where_an_episode_begins(pushed):
    loop, readings, _ = pushed
    method = OutputErrorMethod(loop, np.zeros(1, bool), unit_of(loop))
    for begin in (0, 20):
        segments = Segments(np.zeros(1, int), np.array([begin]), np.array([20]))
        stage, guess = ReplayStage(1, segments=segments), Guess(unit_of(loop), np.zeros(1))
        ended = method.descend(readings, guess, stage, Budget())
        assert (method.judge(ended, Budget()).start is None) == (begin > 0)


def test_a_tie_and_a_sensor_tell_where_a_joint_is(tmp_path):
    tie = '<equality><joint joint1="block" joint2="arm"/></equality>'
    (tmp_path / "scene.xml").write_text(SCENE.replace("<actuator>", tie + "<actuator>"))
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    loop = OpenLoopReplay.of(simulator, seen, task.parameters.nominal)
    assert not loop.measured.goes_on.any()
