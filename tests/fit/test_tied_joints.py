"""A joint that the model ties to a measured one begins where that is read, not elsewhere."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from simtune.api.commands import load_task as load_declared
from simtune.fit import OpenLoopReplay, Readings, replay_whole
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments, Stretches
from simtune.fit.readings.tied_joints import follow_measured
from simtune.observation import ObservationModel
from simtune.tasks import load_task

GRIPPER = """
<mujoco><option timestep=".002" gravity="0 0 0"/>
  <worldbody>
    <body name="left"><joint name="left" type="slide" axis="1 0 0" ref=".01" damping="1"/>
      <geom size=".01" mass=".1" contype="0"/></body>
    <body name="right"><joint name="right" type="slide" axis="-1 0 0" damping="1"/>
      <geom size=".01" mass=".1" contype="0"/></body>
    <body name="thumb"><joint name="thumb" axis="0 0 1"/><geom size=".01" contype="0"/></body>
  </worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="{} 0 0 0"/></equality>
  <actuator><position name="grip" joint="left" kp="20" kv="2" ctrlrange="0 .1"/></actuator>
</mujoco>"""
OPEN = 0.04


@pytest.mark.parametrize(
    ("factors", "measured", "follows"),
    [
        (".001 .5", 0, (1, 0.001 + 0.5 * (OPEN - 0.01), 0.5)),
        (".001 .5", 1, (0, 0.01 + (OPEN - 0.001) / 0.5, 1 / 0.5)),
        (".001 0", 1, None),  # right says nothing of left
    ],
)
def test_a_joint_is_put_where_its_tie_says(factors, measured, follows):
    """Positions are relative to the model's own pose: left begins at .01."""
    model = mujoco.MjModel.from_xml_string(GRIPPER.format(factors))
    states = np.zeros((2, 3, model.nq + model.nv))
    states[..., measured], states[..., model.nq + measured] = OPEN, 3.0
    expected = states.copy()
    if follows:
        joint, place, speed = follows
        expected[..., joint], expected[..., model.nq + joint] = place, 3.0 * speed
    follow_measured(model, states, np.array([measured]))
    np.testing.assert_allclose(states, expected, atol=1e-12)


def test_a_curved_tie_is_followed_and_not_inverted():
    text = GRIPPER.replace("{} 0 0 0", "0 0 2 0 0")
    model = mujoco.MjModel.from_xml_string(text)
    states = np.zeros((1, model.nq + model.nv))
    states[:, 0], states[:, model.nq] = OPEN, 3.0
    follow_measured(model, states, np.array([0]))
    np.testing.assert_allclose(states[0, [1, 4]], [2 * 0.03**2, 4 * 0.03 * 3], atol=1e-12)
    back = states.copy()
    follow_measured(model, back, np.array([1]))
    np.testing.assert_array_equal(back, states)


def test_ties_that_the_model_turns_off_are_not_followed():
    text = GRIPPER.format("0 1").replace(
        'gravity="0 0 0"/>', '><flag equality="disable"/></option>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    states = np.full((1, model.nq + model.nv), OPEN)
    follow_measured(model, states, np.array([0]))
    np.testing.assert_array_equal(states, OPEN)


@pytest.mark.parametrize("order", [1, -1])
def test_a_chain_of_ties_is_followed_in_whatever_order_it_is_written(order):
    """c is measured; b follows it, and a follows b."""
    bodies = "".join(
        f'<body><joint name="{name}"/><geom size=".05" contype="0"/></body>' for name in "abc"
    )
    ties = ['<joint joint1="a" joint2="b"/>', '<joint joint1="b" joint2="c"/>'][::order]
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{bodies}</worldbody><equality>{''.join(ties)}</equality></mujoco>"
    )
    states = np.zeros((1, 6))
    states[:, [2, 5]] = 0.5, 3.0
    follow_measured(model, states, np.array([2]))
    np.testing.assert_allclose(states, [[0.5, 0.5, 0.5, 3.0, 3.0, 3.0]])


@pytest.fixture
def read(tmp_path) -> Callable[[str], tuple[OpenLoopReplay, np.ndarray]]:
    """Replays of such a gripper, of which one finger is read; and its (N,) unit coordinates."""

    def read(scene: str) -> tuple[OpenLoopReplay, np.ndarray]:
        (tmp_path / "scene.xml").write_text(scene)
        (tmp_path / "tune.toml").write_text("""
model = "scene.xml"
control_timestep_s = 0.05
[actions]
mapping = "direct"
[[sensors]]
name = "fingers"
joints = ["left"]
noise = 0.0001
[[parameters]]
name = "damping"
kind = "damping"
objects = "left"
""")
        task = load_task(str(tmp_path / "tune.toml"))
        simulator, start = task.simulator(image_size=16), task.parameters.nominal
        observation = ObservationModel.of_simulator(task.sensors)
        return set_up_loop(simulator, observation, start), task.parameters.to_unit(start)

    return read


def stretches_of(loop: OpenLoopReplay, unit: np.ndarray) -> Stretches:
    """Of one episode of 8 steps, in which the gripper is open."""
    held = Readings(np.full((1, 8, 1), OPEN), np.full((1, 9, 1), OPEN))
    return loop.cut(held, unit, segments=Segments.evenly(held, 8, 1))


def test_an_open_gripper_stays_open_in_a_replay(read):
    loop, unit = read(GRIPPER.format("0 1"))
    whole = stretches_of(loop, unit)
    played, _ = loop.play(whole, whole.states[None], unit[None])
    assert loop.unseen == ("thumb",)
    np.testing.assert_allclose(played.ravel(), OPEN, atol=1e-4)


def test_an_initial_state_moves_both_fingers(read):
    """Else their tie would pull both half the way back, and a coasting gripper would tell it."""
    coasting = GRIPPER.format("0 1").replace('kp="20" kv="2"', 'kp="0"')
    loop, unit = read(coasting)
    whole = stretches_of(loop, unit)
    slopes = differentiate(loop, DifferencePoint(whole, whole.states, unit, np.ones(2)))
    np.testing.assert_allclose(slopes.by_start[0, 0], 1.0, atol=1e-3)
    moved = loop.measured.moved(whole.states, np.array([[0.01, 0.2]]), np.ones(2))
    _, full_states = loop.play(whole, moved[None], unit[None])
    begun = loop.physics.states(full_states[0, 0])
    np.testing.assert_allclose(begun[:2], [OPEN + 0.01, OPEN], atol=1e-9)
    np.testing.assert_allclose(begun[3:5], 0.2, atol=1e-9)


TURNING = """
<mujoco><compiler angle="radian"/><option timestep=".002"/>
  <default><geom type="capsule" size=".01" fromto="0 0 0 .2 0 0" contype="0"/></default>
  <worldbody>
    <body><joint name="a" axis="0 1 0" damping=".1" armature=".01"/><geom mass=".3"/></body>
    <body pos=".5 0 0"><joint name="b" axis="0 1 0" damping=".1"/><geom mass=".4"/></body>
  </worldbody>
  <equality><joint name="tie" joint1="b" joint2="a" polycoef="0 -1 0 0 0"/></equality>
  <actuator><position name="turn" joint="a" kp="6" kv=".6"/></actuator>
</mujoco>"""
OFFSET = {"name": "x", "kind": "joint_offset", "objects": "a"}
RATIO = {"name": "x", "field": "eq_data", "objects": "tie", "component": 1, "low": -2, "high": 2}


@pytest.mark.parametrize(("parameter", "truth"), [(OFFSET, 0.08), (RATIO, -1.3)])
def test_a_world_begins_as_its_own_tie_says(parameter, truth):
    """By plain MuJoCo: a tie is relative to the model's pose, which an offset moves."""
    model = mujoco.MjModel.from_xml_string(TURNING)
    if parameter is OFFSET:
        model.qpos0[0] = model.qpos_spring[0] = truth
    else:
        model.eq_data[0, 1] = truth
    mujoco.mj_setConst(model, data := mujoco.MjData(model))
    actions, angles = 0.7 + 0.3 * np.sin(0.5 * np.arange(40)), []
    data.ctrl[:] = actions[0]
    mujoco.mj_step(model, data, 2000)
    for action in [*actions, actions[-1]]:
        angles.append(data.qpos.copy())
        data.ctrl[:] = action
        mujoco.mj_step(model, data, 25)
    angles = np.array(angles)
    task = load_declared(
        {
            "model": mujoco.MjSpec.from_string(TURNING),
            "control_timestep_s": 0.05,
            "sensors": [{"name": "a", "joints": ["a"], "offset": 0}],
            "parameters": [parameter],
        }
    )
    simulator = task.simulator(image_size=16)
    observation = ObservationModel.of_simulator(task.sensors)
    loop = set_up_loop(simulator, observation, task.parameters.nominal)
    units = task.parameters.to_unit(np.array([task.parameters.nominal, [truth]]))
    readings = Readings(actions[None, :, None], angles[None, :, :1])
    some = loop.cut(readings, units[1], segments=Segments.evenly(readings, 8))
    np.testing.assert_allclose(some.states[2, :2], angles[16], atol=5e-3)  # ties are soft
    played, first = loop.play(some, np.repeat(some.states[None], 2, 0), units)
    as_nominal = loop.physics.states(first)[0, 2, 1]
    assert as_nominal == pytest.approx(-angles[16, 0], abs=1e-3)
    np.testing.assert_allclose(played[1, 2], some.values[2], atol=2e-3)
    replayed = replay_whole(loop, readings, units[1], np.zeros(1))
    np.testing.assert_allclose(replayed[0, :, 0], angles[:, 0], atol=1e-3)
