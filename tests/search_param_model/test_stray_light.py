"""Shadows and reflections that simulated pictures get, where a camera is to be looked past."""

from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from search_context import CARTPOLE
from search_context import SPACE as CARTPOLE_SPACE

from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace, colour
from simtune.randomization import Distribution
from simtune.search_param_model.simulated import play_worlds
from simtune.search_param_model.training_pictures import TrainingPictures
from simtune.simulation import OpenGLQuality, PictureSettings, RendererName, Rollouts, StrayLight
from simtune.simulation.rendering.renderer import make_renderer
from simtune.vision.keypoints import Keypoints

SIZE = 64
# One lamp far above, grey ground, a ball .5 m over it that glows red. Cameras of 90°: half a
# picture is as many metres as they are away.
SCENE = """
<mujoco>
  <visual><headlight active="0"/></visual>
  <asset><material name="red" rgba="1 0 0 1" emission="1"/></asset>
  <worldbody>
    <light directional="true" pos="0 0 4" dir="0 0 -1" diffuse=".8 .8 .8" specular="0 0 0"/>
    <camera name="above" pos="0 0 2" fovy="90"/>
    <camera name="beside" pos="0 -2 1" xyaxes="1 0 0 0 0 1" fovy="90"/>
    <geom name="ground" type="plane" size="5 5 .1" rgba=".5 .5 .5 1"/>
    <body pos="0 0 .5"><joint type="slide"/><geom size=".1" mass="1" material="red"/></body>
  </worldbody>
</mujoco>
"""
SPACE = ParameterSpace(colour("ground", ("ground",), (0.5, 0.5, 0.5)))
LIT = 255 * 0.5 * 0.8  # of the ground


def drawn(camera: str, stray: StrayLight | None, kind: RendererName = "raycaster") -> np.ndarray:
    """(H, W, 3)"""
    model = mujoco.MjModel.from_xml_string(SCENE)
    kind_of_light = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty((1, mujoco.mj_stateSize(model, kind_of_light)))
    mujoco.mj_getState(model, mujoco.MjData(model), state[0], kind_of_light)
    quality = OpenGLQuality(shadow_map_px=1024, reflections=True)
    settings = PictureSettings(image_size=SIZE, renderer=kind, quality=quality)
    renderer = make_renderer(model, SPACE, View(camera), settings)
    return renderer.render(state, SPACE.nominal[None], stray)[0].astype(int)


def stray(shadow=0.0, mirror=0.0, aside=(0.0, 0.0, 0.0)) -> StrayLight:
    return StrayLight(np.array([shadow]), np.array([mirror]), np.array([aside]), np.zeros(1, int))


def pixel(across_m: float, down_m: float, away_m: float) -> tuple[int, int]:
    """Row and column of a point before a camera."""
    middle, half = (SIZE - 1) / 2, SIZE / 2
    return round(middle + half * down_m / away_m), round(middle + half * across_m / away_m)


def test_a_shadow_lacks_its_share_of_the_lamp_and_falls_aside():
    # From a height of .5 m, towards a lamp 45° to the right: .5 m to the left of the ball
    row, column = pixel(-0.5, 0, 2)
    for share in (0.25, 1.0):
        frame = drawn("above", stray(shadow=share, aside=(1, 0, 0)))
        assert frame[row, column].tolist() == pytest.approx([LIT * (1 - share)] * 3, abs=1)
        assert frame[row, -column].tolist() == pytest.approx([LIT] * 3, abs=1)
    assert drawn("above", None)[row, column].tolist() == pytest.approx([LIT] * 3, abs=1)


def test_scenes_of_meshes_get_shadows_in_the_rooms_that_have_some():
    corners = " ".join(
        f"{x} {y} {z}" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)
    )
    scene = SCENE.replace(
        '<geom size=".1" mass="1" material="red"/>', '<geom type="mesh" mesh="c"/>'
    )
    scene = scene.replace("<asset>", f'<asset><mesh name="c" vertex="{corners}"/>')
    scene = scene.replace('dir="0 0 -1"', 'dir="-1 0 -1"')  # from the right, at 45°
    model = mujoco.MjModel.from_xml_string(scene)
    renderer = make_renderer(model, SPACE, View("above"), PictureSettings(image_size=SIZE))
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, mujoco.MjData(model), state, kind)
    given = np.tile(state, (3, 1)), np.tile(SPACE.nominal, (3, 1))
    rooms = StrayLight.none(3)._replace(shadow=np.array([0.0, 0.7, 1.0]), mirror=np.full(3, 0.4))
    plain, shaded = renderer.render(*given).astype(int), renderer.render(*given, rooms).astype(int)
    row, column = pixel(-0.5, 0, 2)  # the box is .5 m above the ground
    lit = LIT * 0.5**0.5
    assert plain[:, row, column, 0].tolist() == pytest.approx([lit] * 3, abs=1)
    assert shaded[:, row, column, 0].tolist() == pytest.approx([lit, 0.1 * lit, 0.1 * lit], abs=1)
    np.testing.assert_array_equal(shaded[0], plain[0])
    np.testing.assert_array_equal(shaded[:, :, SIZE // 2 + 8 :], plain[:, :, SIZE // 2 + 8 :])
    np.testing.assert_array_equal(renderer.render(*given), plain)


def test_a_plane_shows_the_ball_as_far_below_it_as_the_ball_is_above():
    at = pixel(0, 1 + 0.5, 2)
    frame = drawn("beside", stray(mirror=0.4))
    assert frame[at].tolist() == pytest.approx([0.6 * LIT + 0.4 * 255, 0.6 * LIT, 0.6 * LIT], abs=1)
    assert drawn("beside", None)[at].tolist() == pytest.approx([LIT] * 3, abs=1)


def test_without_stray_light_pictures_are_the_simulators_own():
    for camera in ("above", "beside"):
        np.testing.assert_array_equal(drawn(camera, stray()), drawn(camera, None))


@pytest.mark.opengl
def test_shadows_are_where_opengl_has_them():
    try:
        expected = drawn("beside", None, "opengl")
    except InputError as error:
        pytest.skip(str(error))
    plain, shaded = (np.abs(drawn("beside", s) - expected) for s in (None, stray(shadow=1.0)))
    assert shaded.mean() < 0.5 * plain.mean()


def test_rooms_differ_and_simulated_worlds_have_none():
    rng = np.random.default_rng(0)
    assert ObservationModel.of_simulator().stray_light(3, rng) is None
    rooms = ObservationModel.of_reality().stray_light(400, rng)
    assert rooms is not None
    for its, share in ((rooms.shadow, 0.8), (rooms.mirror, 0.5)):
        assert (its > 0).mean() == pytest.approx(share, abs=0.07)
        assert len(np.unique(its[its > 0])) == (its > 0).sum()


def test_a_recorded_world_is_one_room_and_simulated_worlds_are_many(monkeypatch):
    rooms: list[StrayLight] = []

    def film(rollouts: Rollouts, stray: StrayLight) -> np.ndarray:
        rooms.append(stray)
        return np.zeros((*rollouts.states.shape[:2], 8, 8, 3), np.uint8)

    rng, seen, size = np.random.default_rng(0), ObservationModel.of_reality(), (6, 3, 1)
    episodes = Rollouts(
        np.zeros((6, 1)),
        np.zeros(size),
        np.zeros((6, 2, 1)),
        np.full(6, 2),
        np.zeros((6, 3, 0)),
        np.arange(6),
    )
    anything: Any = SimpleNamespace(film=film, widths=[8], step_s=0.1)
    seen.record(anything, episodes, rng)
    simulator = CARTPOLE.simulator(image_size=8)
    monkeypatch.setattr(simulator, "film", film)
    worlds = np.tile(CARTPOLE_SPACE.nominal, (6, 1))
    played = play_worlds(simulator, Keypoints.none(), worlds, np.zeros((6, 1, 2, 1)), rng, seen)
    played.filmed(2, rng)
    TrainingPictures.draw(played, Distribution.first(CARTPOLE_SPACE, worlds[0]), 20, rng)
    one, many, most = (np.column_stack(room) for room in rooms)
    assert (one == one[0]).all()
    assert len(np.unique(many, axis=0)) == 6
    assert len(np.unique(most, axis=0)) == 20, "each picture is of another room"
