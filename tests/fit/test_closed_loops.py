"""A mechanism's loop is closed where a replay begins, though only its crank is read."""

import mujoco
import numpy as np
import pytest

from simtune.api.commands import load_task
from simtune.fit import Readings, replay_whole
from simtune.fit.readings.closed_loops import ClosedLoops
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments
from simtune.observation import ObservationModel
from simtune.tasks import Task

LINKAGE = """
<mujoco><compiler angle="radian"/><option timestep=".002"/>
  <default><geom type="capsule" size=".01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="crank" axis="0 1 0" damping=".05" armature=".005"/>
      <geom fromto="0 0 0 0 0 .2" mass=".2"/>
      <body pos="0 0 .2"><joint name="coupler" axis="0 1 0" damping=".01" armature=".001"/>
        <geom fromto="0 0 0 .3 0 0" mass=".3"/><body name="end" pos=".3 0 0"/></body></body>
    <body name="rocker" pos=".3 0 0"><joint name="rocker" axis="0 1 0" damping=".1"/>
      <geom fromto="0 0 0 0 0 .2" mass=".4"/><site name="tip" pos="0 0 .2"/></body>
    <body pos="0 1 0"><joint name="other" axis="0 1 0"/><geom fromto="0 0 0 0 0 .1"/></body>
  </worldbody>
  <equality>{}</equality>
  <actuator><position name="turn" joint="crank" kp="20" kv="1.5"/></actuator>
</mujoco>"""
CONNECT = '<connect body1="end" body2="rocker" anchor="0 0 0"/>'
CRANK, COUPLER, ROCKER, OTHER = range(4)
STEP_S = 0.05


def loops_of(text: str, measured=(CRANK,)) -> ClosedLoops:
    model = mujoco.MjModel.from_xml_string(text)
    return ClosedLoops(model, np.array(measured), np.array(measured))


def test_a_parallelogram_keeps_its_pose_past_where_it_is_flat():
    """Its rocker turns as its crank, also beyond 90°, where it may fold into a cross instead."""
    loops = loops_of(LINKAGE.format(CONNECT))
    angles = np.linspace(0.9, 2.2, 40)
    states = np.zeros((1, 40, 8))
    states[0, :, CRANK], states[0, :, 4 + CRANK], states[0, :, OTHER] = angles, 3.0, 0.7
    loops.follow(states, np.zeros(8))
    expected = np.stack([angles, -angles, angles, np.full(40, 0.7)], 1)
    np.testing.assert_allclose(states[0, :, :4], expected, atol=1e-7)
    np.testing.assert_allclose(states[0, :, 4:], [[3.0, -3.0, 3.0, 0.0]] * 40, atol=1e-5)


@pytest.mark.parametrize(
    "tie",
    [
        CONNECT,
        '<connect body1="rocker" body2="end" anchor="0 0 .2"/>',
        '<connect site1="tip" site2="end_of_coupler"/>',
        CONNECT + '<joint joint1="other" joint2="rocker" polycoef="0 1 0 0 0"/>',
    ],
)
def test_loops_are_closed_however_they_are_written(tie):
    text = LINKAGE.format(tie).replace(
        '<body name="end" pos=".3 0 0"/>',
        '<body name="end" pos=".3 0 0"><site name="end_of_coupler"/></body>',
    )
    loops = loops_of(text)
    states = np.zeros((1, 8))
    states[0, [CRANK, 4 + CRANK]] = 0.2, 1.0
    loops.close(states)
    other = [0.2, 1.0] if "polycoef" in tie else [0.0, 0.0]
    np.testing.assert_allclose(states[0, :4], [0.2, -0.2, 0.2, other[0]], atol=1e-7)
    np.testing.assert_allclose(states[0, 4:], [1.0, -1.0, 1.0, other[1]], atol=1e-6)


def test_what_a_weld_holds_goes_with_the_arm():
    """A block that a gripper holds: the weld ties its free joint to the arm's."""
    loops = loops_of("""
<mujoco><compiler angle="radian"/><worldbody>
  <body name="arm"><joint axis="0 1 0"/><geom size=".02" pos=".5 0 0"/></body>
  <body name="block" pos=".5 0 0"><freejoint/><geom size=".02"/></body>
</worldbody><equality><weld body1="arm" body2="block"/></equality></mujoco>""")
    states = np.zeros((1, 8 + 7))
    states[0, :8], states[0, 8] = [0, 0.5, 0, 0, 1, 0, 0, 0], 2.0
    begun = states[0].copy()
    states[0, 0] = 1.2
    loops.follow(states[None], begun)
    turned = [np.cos(0.6), 0, np.sin(0.6), 0]
    place = [0.5 * np.cos(1.2), 0, -0.5 * np.sin(1.2)]
    np.testing.assert_allclose(states[0, :8], [1.2, *place, *turned], atol=1e-7)
    velocity = 2.0 * 0.5 * np.array([-np.sin(1.2), 0, -np.cos(1.2)])
    np.testing.assert_allclose(states[0, 9:], [*velocity, 0, 2.0, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("tie", "measured"),
    [
        (CONNECT.replace("/>", ' active="false"/>'), [CRANK]),
        (CONNECT, [CRANK, COUPLER, ROCKER]),  # nothing is left to place
        (CONNECT, [OTHER]),  # no part of the loop is measured
        ("", [CRANK]),
        (CONNECT + '</equality><option><flag equality="disable"/></option><equality>', [CRANK]),
    ],
)
def test_other_models_have_no_loop_to_close(tie, measured):
    assert not loops_of(LINKAGE.format(tie), measured)


def test_a_world_that_diverged_is_left_as_it_is():
    states = np.full((1, 8), np.nan)
    loops_of(LINKAGE.format(CONNECT)).close(states)
    assert np.isnan(states).all()


def test_a_loop_to_a_mocap_body_is_left_to_the_actions_that_place_it():
    text = LINKAGE.format('<weld body1="rocker" body2="hand"/>').replace(
        "<worldbody>", '<worldbody><body name="hand" mocap="true" pos=".3 0 0"/>'
    )
    assert not loops_of(text, [CRANK])
    assert not loops_of(text, [ROCKER])


CRANK_AND_SLIDER = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="slider" pos=".3 0 0"><joint type="slide" axis="1 0 0"/><geom size=".02"/></body>
  <body><joint name="crank" axis="0 1 0"/><geom size=".01"/>
    <body name="rod" pos=".1 0 0"><joint name="rod" axis="0 1 0"/><geom size=".01"/></body></body>
</worldbody><equality><connect body1="rod" body2="slider" anchor=".2 0 0"/></equality></mujoco>"""


def test_near_a_dead_centre_noise_of_a_slider_is_no_speed_of_its_crank():
    """There the slider turns back, and the least of its noise would be 100 rad/s."""
    loops, times = loops_of(CRANK_AND_SLIDER), np.arange(200) * 0.02
    angles = 0.6 * np.cos(2 * times)
    slid = 0.1 * np.cos(angles) + np.sqrt(0.2**2 - (0.1 * np.sin(angles)) ** 2) - 0.3
    states = np.zeros((1, 200, 6))
    states[0, :, 0] = slid + np.random.default_rng(0).normal(0, 1e-4, 200)
    states[0, :, 3] = np.gradient(states[0, :, 0]) / 0.02
    loops.follow(states, np.array([slid[0], 0.6, -0.88, 0, 0, 0]))
    speeds, apart = np.abs(states[0, :, 4:]), np.abs(np.sin(angles)) > 0.2
    assert speeds.max() < 3.0  # of 1.2 at most, in truth
    true = np.abs(1.2 * np.sin(2 * times))
    assert np.abs(speeds[apart, 0] - true[apart]).max() < 0.3


FIVE_BARS = """<body pos=".3 0 0"><joint axis="0 1 0"/><geom fromto="0 0 0 0 0 -.1"/>
  <body name="end" pos="0 0 -.1"/></body>"""


@pytest.mark.parametrize(
    ("change", "placed"),
    [
        (("", ""), ["coupler", "rocker"]),
        # Of five bars, a crank leaves one joint open
        (('<body name="end" pos=".3 0 0"/>', FIVE_BARS), []),
    ],
)
def test_what_a_loop_places_is_known(change, placed):
    loops = loops_of(LINKAGE.format(CONNECT).replace(*change))
    assert [loops.model.joint(joint).name for joint in loops.placed_joints] == placed


def task_of(text: str) -> Task:
    task = load_task(
        {
            "model": mujoco.MjSpec.from_string(text),
            "control_timestep_s": STEP_S,
            "sensors": [{"name": "crank", "joints": ["crank"], "offset": 0}],
            "parameters": [{"name": "damping", "kind": "damping", "objects": "rocker"}],
        }
    )
    assert isinstance(task, Task)
    return task


BOX = """<body name="box" pos="0 1 0"><freejoint/><geom fromto="0 0 0 0 0 .1"/></body>
</worldbody>"""
OTHER_BODY = LINKAGE[LINKAGE.index('    <body pos="0 1 0">') : LINKAGE.index("  </worldbody>")]


@pytest.mark.parametrize("other", ["", OTHER_BODY])
def test_beside_a_linkage_all_but_a_loose_box_is_known(other):
    """From its crank's readings; a joint in no loop is not."""
    text = LINKAGE.format(CONNECT).replace(OTHER_BODY, other).replace("</worldbody>", BOX)
    task = task_of(text)
    seen = ObservationModel.of_simulator(task.sensors)
    loop = set_up_loop(task.simulator(image_size=16), seen, task.parameters.nominal)
    assert loop.measured.knows_all_but_objects == (not other)


def recorded(text: str, actions: np.ndarray) -> np.ndarray:
    """(T + 1,) angles of the crank by plain MuJoCo, which had long held the first action."""
    model = mujoco.MjModel.from_xml_string(text)
    data, angles = mujoco.MjData(model), []
    data.ctrl[:] = actions[0]
    mujoco.mj_step(model, data, 2000)
    for action in [*actions, actions[-1]]:
        angles.append(data.qpos[CRANK])
        data.ctrl[:] = action
        mujoco.mj_step(model, data, round(STEP_S / model.opt.timestep))
    return np.array(angles)


def test_a_replay_goes_on_as_the_real_linkage_does():
    """Each stretch begins as it was recorded, though its passive joints are not read.

    A linkage that began open would snap shut, and throw the crank off by some 50 mrad.
    """
    longer = LINKAGE.format(CONNECT).replace('"rocker" pos=".3 0 0"', '"rocker" pos=".3 0 -.1"')
    uneven = longer.replace('fromto="0 0 0 0 0 .2" mass=".4"', 'fromto="0 0 0 0 0 .3" mass=".4"')
    actions = 0.7 + 0.3 * np.sin(0.4 * np.arange(40))[:, None]
    task = task_of(uneven)
    start = task.parameters.nominal
    unit = task.parameters.to_unit(start)
    observation = ObservationModel.of_simulator(task.sensors)
    loop = set_up_loop(task.simulator(image_size=16), observation, start)
    angles = recorded(uneven, actions)
    assert np.ptp(angles) > 0.3
    readings = Readings(actions[None], angles[None, :, None])
    replayed = replay_whole(loop, readings, unit, np.zeros(1))
    np.testing.assert_allclose(replayed[0, :, 0], angles, atol=1e-3)
    middle = loop.cut(readings, unit, segments=Segments.evenly(readings, 8)).of(np.arange(5) == 2)
    played, _ = loop.play(middle, middle.states[None], unit[None])
    np.testing.assert_allclose(played[0], middle.values, atol=5e-3)
