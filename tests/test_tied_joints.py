"""A joint that the model ties to a measured one begins where that is read, not elsewhere."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from simtune.fit import OpenLoopReplay, Readings
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.stretches import Stretches
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
        return OpenLoopReplay.of(simulator, observation, start), task.parameters.to_unit(start)

    return read


def stretches_of(loop: OpenLoopReplay, unit: np.ndarray) -> Stretches:
    """Of one episode of 8 steps, in which the gripper is open."""
    held = Readings(np.full((1, 8, 1), OPEN), np.full((1, 9, 1), OPEN))
    return loop.cut(held, unit, np.zeros(1), 8, 1)


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
    np.testing.assert_allclose(moved[0, :2], [OPEN + 0.01, OPEN], atol=1e-9)
    np.testing.assert_allclose(moved[0, 3:5], 0.2, atol=1e-9)
