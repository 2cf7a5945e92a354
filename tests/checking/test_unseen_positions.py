"""Which positions that no sensor observes are looked for in pictures, and how closely."""

import mujoco
import numpy as np
import pytest
from test_extents import TUNING

from simtune.cameras.views import View
from simtune.fit import Physics
from simtune.fit.pictures.poses import align_to_images
from simtune.fit.pictures.unseen import shown_in_pictures, unobserved
from simtune.simulation import StateSpace

SIZE = 64
SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1" fovy="53.13"/>
    <geom name="floor" type="plane" size="0 0 .1" pos="0 0 -1"/>
    <body name="plate">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="turn" type="hinge" axis="0 1 0"/>
      <geom name="plate" type="box" size=".5 .001 .125"/>
    </body>
    <body name="cart" pos="0 8 0">
      <joint name="cart" type="slide" axis="1 0 0"/>
      <geom size=".1"/>
      <camera name="carried" xyaxes="-1 0 0 0 0 1"/>
    </body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
"""


@pytest.fixture
def physics_of(load):
    def make(camera: str) -> Physics:
        simulator = load(TUNING).simulator(image_size=SIZE, views=[View(camera)])
        state = simulator.begin(simulator.space.nominal[None], np.random.default_rng(0)).states
        return Physics(simulator, lambda batch: batch.qpos[:, :1], state[0, 0])

    return make


def test_how_far_a_change_moves_things_in_the_picture(physics_of):
    """53.13 degrees see 4 m at a distance of 4 m: 16 pixels a metre."""
    physics = physics_of("front")
    changes = np.zeros((4, 6))
    changes[0, 0], changes[1, 0], changes[2, 1] = 0.1, 0.01, np.pi
    changes[3, 2] = 0.1  # of what is a quarter as large, behind the plate
    nominal = physics.parameters.nominal
    full = physics.full_states(np.zeros((3, 6)))
    shown, shifts = shown_in_pictures(physics, full, nominal, changes)
    np.testing.assert_array_equal(shown, changes[[0, 2, 3]])
    assert shifts[0] == pytest.approx(1.6, rel=0.01)
    assert shifts[1] == pytest.approx(16 * np.pi * 0.5, rel=0.05)  # its ends go up and down
    assert shifts[2] == pytest.approx(0.1 * 64 / 12, rel=0.02)


def test_a_camera_that_moves_shows_more_than_what_moves_before_it(physics_of):
    physics, changes = physics_of("carried"), np.zeros((2, 6))
    changes[0, 0], changes[1, 2] = 0.01, 0.01
    full = physics.full_states(np.zeros((1, 6)))
    shown, shifts = shown_in_pictures(physics, full, physics.parameters.nominal, changes)
    np.testing.assert_array_equal(shown, changes[1:])
    assert shifts.tolist() == [np.inf]


def test_nothing_is_looked_for_where_sensors_tell_all(physics_of):
    physics = physics_of("front")
    found = shown_in_pictures(
        physics, physics.full_states(np.zeros((1, 6))), physics.parameters.nominal, np.zeros((0, 6))
    )
    assert [len(each) for each in found] == [0, 0]


def test_what_no_sensor_observes_is_looked_for_within_half_a_turn(physics_of):
    physics, usual = physics_of("front"), np.array([0.1, 1.4, 0.2, 1.0, 1.0, 1.0])
    found = unobserved(physics, usual, np.array([0.01]))
    np.testing.assert_allclose(found, np.diag([0.5, np.pi, 1.0, 0, 0, 0])[1:3])


def test_turns_end_after_half_of_one():
    joints = "<joint type='slide'/><joint/><joint limited='true' range='-400 400'/>"
    bodies = f"<body>{joints}<geom size='.1'/></body><body><freejoint/><geom size='.1'/></body>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    largest = StateSpace(model).largest_change
    turn, none = [np.pi], [np.inf]
    np.testing.assert_array_equal(largest, 1 * none + turn + none + 3 * none + 3 * turn + 9 * none)


@pytest.mark.parametrize(("shift_px", "saved"), [(3.0, 1.0), (24.0, 1.5)])
def test_places_are_tried_no_closer_than_half_a_pixel_apart(shift_px, saved):
    """A bar with edges that are an eighth of a pixel wide: places must be near to look alike."""
    body = "<body><joint type='slide'/><geom size='.1'/></body>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    space, drawn = StateSpace(model), []
    pixels, rng = np.arange(96) - 48, np.random.default_rng(0)
    full = np.zeros((12, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)))

    def render(full_states: np.ndarray, _: np.ndarray) -> np.ndarray:
        x_px = space.positions_and_velocities(full_states)[:, :1]
        drawn.append(len(x_px))
        level = 200.0 * np.clip(8 * (5 - np.abs(pixels - x_px)), 0, 1)
        return np.repeat(level[:, None, :, None], 3, 3).astype(np.uint8)

    true, none = rng.uniform(-1, 1, (12, 1)) * [shift_px, 0.0], np.zeros(1)
    frames = render(space.with_positions_and_velocities(full, true), np.zeros((12, 1)))
    tangent, searched = np.array([shift_px, 0.0]), []
    for most in (shift_px, np.inf):
        drawn.clear()
        found, _ = align_to_images(render, frames, full, none, space, tangent, most)
        assert np.abs(space.positions_and_velocities(found) - true)[:, 0].max() < 1.0
        searched.append(sum(drawn) / 12)  # pictures for each frame
    refined, spacing = 2 * 3, 5 * 4
    assert searched[0] <= 25 + max(27, 4 * shift_px + 1) + spacing + refined
    assert searched[1] >= saved * searched[0]
