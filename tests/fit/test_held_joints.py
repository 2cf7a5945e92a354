"""Actuators that integrate a velocity hold their joint where an episode begins."""

import numpy as np
import pytest

from simtune.fit import Physics
from simtune.tasks import Task

SCENE = """
<mujoco><option timestep=".002" gravity="0 0 0"/>
  <worldbody><camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <body><joint name="elbow" axis="0 -1 0" damping="1"/>
    <geom size=".01" pos=".5 0 0" mass="1"/></body></worldbody>
  <actuator><intvelocity name="turn" joint="elbow" kp="50" kv="5" gear="2"
    actrange="-4 4"/></actuator>
  <keyframe><key name="up" qpos=".8"/><key name="pulled" qpos=".8" act="1.8"/></keyframe>
</mujoco>"""
TUNING = """
model = "scene.xml"
control_timestep_s = 0.02
actions = {mapping = "direct"}
[initial_state]
START
[[parameters]]
name = "damping"
kind = "damping"
objects = "elbow"
[[parameters]]
name = "gear"
kind = "gear"
objects = "turn"
"""
DAMPING = """
model = "scene.xml"
control_timestep_s = 0.02
actions = {mapping = "direct"}
[[parameters]]
name = "damping"
kind = "damping"
objects = "elbow"
"""
AT_KEYFRAME = "kind = 'keyframe'\nkeyframe = 'KEY'"
AROUND_KEYFRAME = (
    "kind = 'distribution'\nkeyframe = 'KEY'\njoints = {elbow = {position = [-1.5, -0.5]}}"
)
STEPS = 60


@pytest.fixture
def start(load):
    """Loads a task of a start around a keyframe."""

    def start(kind: str, keyframe: str) -> Task:
        return load(TUNING.replace("START", kind.replace("KEY", keyframe)))

    return start


def angles(states: np.ndarray) -> np.ndarray:
    return states[..., 1]


def still(task: Task) -> np.ndarray:
    """(3, T + 1, S) states of three worlds whose controls are 0."""
    worlds, rng = np.repeat(task.parameters.nominal[None], 3, 0), np.random.default_rng(0)
    return task.simulator(image_size=16).roll_out(worlds, np.zeros((3, STEPS, 1)), rng).states


@pytest.mark.parametrize("kind", [AT_KEYFRAME, AROUND_KEYFRAME])
@pytest.mark.parametrize(("keyframe", "pulled_by"), [("up", 0.0), ("pulled", 0.1)])
def test_a_joint_stays_where_it_begins_unless_its_keyframe_pulls_it(
    start, kind, keyframe, pulled_by
):
    """An activation of 1.8 at a length of 2 x .8 pulls the joint .1 farther."""
    at = angles(still(start(kind, keyframe)))
    np.testing.assert_allclose(at[:, -1] - at[:, 0], pulled_by, atol=1e-4)


@pytest.mark.parametrize(
    ("keyframe", "gear", "pulled_by"), [("up", 2, 0.0), ("up", 3, 0.0), ("pulled", 2, 0.1)]
)
def test_a_replay_begins_where_the_recording_does_not_where_the_task_does(
    start, keyframe, gear, pulled_by
):
    task = start(AT_KEYFRAME, keyframe)
    physics = Physics(task.simulator(image_size=16), angles_of, still(task)[0, 0])
    actions, values = np.zeros((2, STEPS, 1)), task.parameters.nominal.copy()
    values[task.parameters.names.index("gear")] = gear
    unit = task.parameters.to_unit(values)
    begun = np.array([[-0.5, 0.0], [1.2, 0.0]])
    left = physics.replay_actuators(actions, np.repeat(begun[:, None], STEPS + 1, 1), unit)
    for t in (0, STEPS // 2):  # also from its middle
        ended = physics.play(begun, np.repeat(unit[None], 2, 0), actions, left[:, t])[0][:, -1]
        np.testing.assert_allclose(angles(ended) - begun[:, 0], pulled_by, atol=1e-4)


REMEMBERS = """
<mujoco><extension><plugin plugin="mujoco.pid"/></extension>
  <option timestep=".002" gravity="0 0 0"/>
  <worldbody><camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <body><joint name="elbow" axis="0 -1 0" damping="1"/>
    <geom size=".01" pos=".5 0 0" mass="1"/></body></worldbody>
  <actuator>ACTUATOR</actuator>
</mujoco>"""
REMEMBERED = {
    "integrated error": '<pid joint="elbow" kp="20" ki="40" input="pos"/>',
    "current": '<dcmotor joint="elbow" motorconst="2" resistance="1" inductance=".2"/>',
    "of a plugin": """<plugin joint="elbow" plugin="mujoco.pid" actdim="1">
        <config key="kp" value="20"/><config key="ki" value="40"/></plugin>""",
}


@pytest.mark.parametrize("what", REMEMBERED)
def test_a_replay_from_the_middle_has_what_actuators_remember_of_the_motion(
    folder, load, monkeypatch, what
):
    monkeypatch.setattr("simtune.simulation.rendering.renderers.make_renderer", lambda *_: None)
    (folder / "scene.xml").write_text(REMEMBERS.replace("ACTUATOR", REMEMBERED[what]))
    task = load(DAMPING)
    simulator, unit = (
        task.simulator(image_size=16),
        task.parameters.to_unit(task.parameters.nominal),
    )
    physics = Physics(simulator, angles_of, still(task)[0, 0])
    actions, begun = np.full((1, STEPS, 1), 0.5), np.array([[-1.5, 2.0]])  # not as the task does
    true = physics.states(physics.play(begun, unit[None], actions)[0])
    left, middle = physics.replay_actuators(actions, true, unit), STEPS // 4
    again, _ = physics.play(true[:, middle], unit[None], actions[:, middle:], left[:, middle])
    np.testing.assert_allclose(physics.states(again), true[:, middle:], atol=1e-6)


def angles_of(batch) -> np.ndarray:
    return batch.qpos.copy()


def test_a_velocity_moves_the_joint_on_from_there(start):
    task = start(AT_KEYFRAME, "up")
    simulator, rng = task.simulator(image_size=16), np.random.default_rng(0)
    turned = simulator.roll_out(
        task.parameters.nominal[None], np.full((1, STEPS, 1), 0.5), rng
    ).states
    # 0.5 of length per second for 1.2 s, by a gear of 2, less what it lags behind
    assert angles(turned)[0, -1] == pytest.approx(0.8 + 0.5 * 1.2 / 2, abs=0.05)
