"""Robots that stand: where a base begins that no sensor measures."""

import mujoco
import numpy as np
import pytest

from simtune.fit.readings.standing import stood

LEG = """
<body pos="{x} {y} 0">
  <joint name="hip_{name}" type="slide" axis="0 0 1"/>
  <geom name="foot_{name}" type="sphere" size=".02" pos="0 0 -.2" mass=".1"/>
</body>"""
CORNERS = {"a": (0.2, 0.1), "b": (0.2, -0.1), "c": (-0.2, 0.1), "d": (-0.2, -0.1)}
LEGS = "".join(LEG.format(name=name, x=x, y=y) for name, (x, y) in CORNERS.items())
SCENE = f"""
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="trunk" pos="0 0 .219"><freejoint/>
      <geom type="box" size=".25 .1 .02" mass="2"/>{LEGS}
      <body pos="0 0 .1"><joint name="finger" type="slide" axis="1 0 0"/>
        <geom name="finger" type="sphere" size=".02" mass=".1"/></body>
      <body pos=".04 0 .1"><joint name="thumb" type="slide" axis="1 0 0"/>
        <geom name="thumb" type="sphere" size=".0201" mass=".1"/></body>
    </body>
  </worldbody>
</mujoco>"""
BASE = np.arange(6)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


@pytest.fixture(scope="module")
def settled(model) -> np.ndarray:
    """All feet are 1 mm in the floor."""
    return np.concatenate([model.qpos0, np.zeros(model.nv)])


def with_legs(settled: np.ndarray, *lower: float) -> np.ndarray:
    """The state with each foot that much lower, beside the trunk."""
    state = settled.copy()
    state[7:11] -= lower
    return state


def test_a_trunk_is_as_high_as_its_legs_are_long(model, settled):
    state = with_legs(settled, *[0.03] * 4)
    state[[0, 1]] = 0.4, -0.3
    state[11] -= 0.01  # a finger, that touched the thumb
    (found,) = stood(model, state[None], settled, BASE)
    np.testing.assert_allclose(found[2], settled[2] + 0.03, atol=1e-6)
    np.testing.assert_allclose(np.delete(found, 2), np.delete(state, 2), atol=1e-6)


def test_a_trunk_leans_where_its_front_legs_are_longer(model, settled):
    """By 2 cm over 40 cm of its length."""
    (found,) = stood(model, with_legs(settled, 0.02, 0.02, 0, 0)[None], settled, BASE)
    data = mujoco.MjData(model)
    data.qpos[:] = found[: model.nq]
    mujoco.mj_kinematics(model, data)
    feet = [data.geom(f"foot_{name}").xpos[2] for name in CORNERS]
    np.testing.assert_allclose(feet, 0.019, atol=1e-4)
    assert np.degrees(2 * np.arcsin(abs(found[5]))) == pytest.approx(2.86, abs=0.02)


@pytest.mark.parametrize(
    "lower", [(0, 0, 0, -0.05), (0.2, 0.2, 0.2, 0.2)], ids=["lifts a foot", "hangs"]
)
def test_a_robot_that_does_not_stand_stays_where_it_is(model, settled, lower):
    state = with_legs(settled, *lower)
    np.testing.assert_array_equal(stood(model, state[None], settled, BASE), state[None])


def test_where_nothing_touches_or_the_base_is_read_nothing_is_moved(model, settled):
    state, flying = with_legs(settled, *[0.03] * 4), settled.copy()
    flying[2] += 0.5
    np.testing.assert_array_equal(stood(model, state[None], flying, BASE), state[None])
    np.testing.assert_array_equal(stood(model, state[None], settled, BASE[:0]), state[None])
