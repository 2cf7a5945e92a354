"""Both renderers draw the same worlds, and each world in its own parameters."""

import copy
import functools
import sys
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import mujoco_warp
import numpy as np
import pytest
from late_actuators import delay

from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.parameters import (
    ModelWriter,
    ParameterSpace,
    camera_pose,
    colour,
    field_of_view,
)
from simtune.simulation import (
    OPENGL_DM_CONTROL,
    OpenGLQuality,
    PictureSettings,
    Simulator,
    random_actions,
)
from simtune.simulation.rendering import opengl
from simtune.simulation.rendering.constant_sky import constant_sky
from simtune.simulation.rendering.depths import Depths
from simtune.simulation.rendering.primitives import drawing
from simtune.simulation.rendering.primitives.drawing import Primitives
from simtune.simulation.rendering.raycaster import Raycaster
from simtune.simulation.rendering.renderer import Renderer, make_renderer
from simtune.simulation.rendering.sky import smooth_sky
from simtune.tasks import TASKS, Task, load_task

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SIZE = 32
ABOVE, SMALL = View("above"), PictureSettings(image_size=SIZE)
SHADOWS = OpenGLQuality(shadow_map_px=1024)  # without, OpenGL's brightness saturates early

# A camera looks down at the ground, a ball in the middle; half of the picture is sky.
SCENE = """
<mujoco>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".3 .5 .7" rgb2="0 0 .1"
             width="64" height="384"/>
    <material name="striped" rgba=".2 .9 .2 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 4" directional="true" diffuse=".4 .4 .4" specular="0 0 0"/>
    <camera name="above" pos="0 -1 1" xyaxes="1 0 0 0 1 1.4"/>
    <geom name="ground" type="plane" pos="0 0 0" size="1 .5 .1" rgba=".4 .4 .4 1"/>
    <body name="ball" pos="0 0 .2">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom name="ball" size=".15" mass="1" material="striped"/>
    </body>
  </worldbody>
</mujoco>
"""
SPACE = ParameterSpace(
    [*colour("ground", ("ground",), (0.4, 0.4, 0.4)), *colour("ball", ("ball",), (0.2, 0.9, 0.2))]
)
# A fixed camera, a tracking one, and a mocap body; the others in the slow tests.
ALL_TASKS = [
    pytest.param(n, marks=() if n in ("ball_in_cup", "walker", "rope_peg") else pytest.mark.slow)
    for n in TASKS
]
RED, GREY, BLUE = (0.8, 0.1, 0.1), (0.5, 0.5, 0.5), (0.1, 0.1, 0.8)


@pytest.fixture(autouse=True, scope="module")
def _simulators_given_back():
    yield
    simulator_of.cache_clear()
    filmed_otherwise.cache_clear()


@pytest.fixture(scope="module")
def scene() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


def opengl_or_skip(model, space, camera, image_size, quality=SHADOWS) -> Renderer:
    try:
        settings = PictureSettings(image_size=image_size, renderer="opengl", quality=quality)
        return make_renderer(model, space, View(camera), settings)
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture(
    scope="module", params=["raycaster", pytest.param("opengl", marks=pytest.mark.opengl)]
)
def renderer(request, scene) -> Renderer:
    if request.param == "opengl":
        return opengl_or_skip(scene, SPACE, "above", SIZE)
    return make_renderer(scene, SPACE, ABOVE, SMALL)


def states_of(model: mujoco.MjModel, positions: list[float]) -> np.ndarray:
    """(n, S) states with the ball at these positions."""
    data = mujoco.MjData(model)
    states = np.empty((len(positions), mujoco.mj_stateSize(model, STATE)))
    for state, position in zip(states, positions, strict=True):
        data.qpos[0] = position
        mujoco.mj_getState(model, data, state, STATE)
    return states


def initial_state(model: mujoco.MjModel) -> np.ndarray:
    """(1, S)."""
    state = np.empty((1, mujoco.mj_stateSize(model, STATE)))
    mujoco.mj_getState(model, mujoco.MjData(model), state[0], STATE)
    return state


def painted(*colours: tuple) -> np.ndarray:
    """(n, 6) parameters from (ground, ball) colours."""
    return np.array([[*ground, *ball] for ground, ball in colours])


def draw_one(renderer: Renderer, scene, ground, ball, position=0.0) -> np.ndarray:
    return renderer.render(states_of(scene, [position]), painted((ground, ball)))[0].astype(int)


def test_a_red_ground_is_red_and_a_blue_ball_is_blue(renderer, scene):
    frame = draw_one(renderer, scene, RED, BLUE)
    ground, ball = frame[-2, SIZE // 2], frame[ball_mask(renderer, scene)].mean(axis=0)
    assert ground[0] > 2 * ground[1:].max()
    assert ball[2] > 2 * ball[:2].max()


def ball_mask(renderer: Renderer, scene) -> np.ndarray:
    """(H, W) bool: where the ball's colour matters."""
    difference = draw_one(renderer, scene, GREY, BLUE) - draw_one(renderer, scene, GREY, RED)
    mask = np.abs(difference).sum(axis=-1) > 60
    assert 10 < mask.sum() < SIZE**2 / 4
    return mask


def test_each_world_is_drawn_with_its_own_parameters_and_state(renderer, scene):
    states = states_of(scene, [0.0, 0.0, 0.3])
    frames = renderer.render(states, painted((RED, BLUE), (BLUE, BLUE), (RED, BLUE))).astype(int)
    ball = ball_mask(renderer, scene)
    assert frames[0, -2, 16, 0] > 2 * frames[1, -2, 16, 0]
    np.testing.assert_array_equal(frames[0, 0], frames[1, 0])  # the sky has no parameters
    assert np.abs(frames[0][ball] - frames[1][ball]).mean() < 1
    assert np.abs(frames[0][ball] - frames[2][ball]).mean() > 20


def test_a_colour_of_exactly_half_grey_is_that_and_not_the_materials(renderer, scene):
    ball = ball_mask(renderer, scene)
    grey = draw_one(renderer, scene, RED, GREY)[ball]
    nearly = draw_one(renderer, scene, RED, (0.501, 0.501, 0.501))[ball]
    assert np.abs(grey - nearly).max() <= 2
    assert np.ptp(grey.mean(axis=0)) < 5  # the material is green


def test_the_order_and_number_of_pictures_do_not_matter(renderer, scene):
    n = 150  # more than one launch, and no multiple of one
    rng = np.random.default_rng(0)
    states, parameters = states_of(scene, list(rng.uniform(-0.5, 0.5, n))), rng.random((n, 6))
    together = renderer.render(states, parameters)
    assert together.shape == (n, SIZE, SIZE, 3)
    alone = [renderer.render(states[i : i + 1], parameters[i : i + 1])[0] for i in range(0, n, 7)]
    np.testing.assert_array_equal(together[::7], alone)
    order = rng.permutation(n)
    np.testing.assert_array_equal(
        renderer.render(states[order], parameters[order]), together[order]
    )
    assert renderer.render(states[:0], parameters[:0]).shape == (0, SIZE, SIZE, 3)


def test_a_thread_draws_worlds_whose_parameters_it_has_written(scene, monkeypatch):
    written: list[int] = []
    write = ModelWriter.write_batch

    def spy(writer: ModelWriter, batch, parameters: np.ndarray) -> None:
        written.append(len(parameters))
        write(writer, batch, parameters)

    monkeypatch.setattr(ModelWriter, "write_batch", spy)
    renderer = Raycaster(scene, SPACE, ABOVE, SMALL, num_threads=3)
    states = states_of(scene, [0.1 * i for i in range(-3, 4)])
    parameters = np.random.default_rng(0).random((7, 6))
    first = renderer.render(states, parameters)
    assert len(written) == 3
    for _ in range(4):
        np.testing.assert_array_equal(renderer.render(states, parameters), first)
    assert len(written) == 3
    renderer.render(states[:1], parameters[:1])  # by whom it was drawn before, with others
    assert len(written) == 4
    renderer.render(states[:1], parameters[:1])
    assert len(written) == 4


def test_one_thread_draws_what_many_draw(scene):
    states = states_of(scene, [0.1 * i for i in range(-5, 5)])
    parameters = np.random.default_rng(0).random((10, 6))
    one, three = (Raycaster(scene, SPACE, ABOVE, SMALL, num_threads=k) for k in (1, 3))
    np.testing.assert_array_equal(one.render(states, parameters), three.render(states, parameters))


def test_the_sky_of_a_fixed_camera_is_the_one_drawn_for_a_camera_that_may_turn(scene):
    states, parameters = states_of(scene, [0.0, 0.3]), painted((RED, BLUE), (GREY, RED))
    fixed = Raycaster(scene, SPACE, ABOVE, SMALL, num_threads=1)
    turning = ParameterSpace([*SPACE, *camera_pose("camera", "above", (0, -1, 1))])
    own = Raycaster(scene, turning, ABOVE, SMALL, num_threads=1)
    frames = own.render(states, np.hstack([parameters, np.tile(turning.nominal[6:], (2, 1))]))
    assert len(np.unique(frames[0, :8].reshape(-1, 3), axis=0)) > 5  # there is a gradient
    difference = fixed.render(states, parameters).astype(int) - frames
    assert np.abs(difference).max() <= 1  # a fixed camera's is the mean over each pixel
    assert abs(difference.mean()) < 0.1


def painted_by(task: Task) -> list[str]:
    """The things that a task's colours paint, but for a ground, which ends at the horizon."""
    reds = [p for p in task.parameters if p.is_colour and p.component == 0]
    model, plane = task.nominal_model, mujoco.mjtGeom.mjGEOM_PLANE
    return [
        red.name.removesuffix("_r")
        for red in reds
        if not any(model.geom(geom).type[0] == plane for geom in red.objects)
    ]


@functools.lru_cache(maxsize=2)
def simulator_of(name: str) -> Simulator:
    return load_task(name).simulator(image_size=84)


def mujoco_warps_own(monkeypatch, model, space, camera: str, image_size: int) -> Raycaster:
    with monkeypatch.context() as patch:
        patch.setattr(Primitives, "can_draw", lambda context: False)
        return Raycaster(model, space, View(camera), PictureSettings(image_size=image_size))


@pytest.fixture
def without_grids(monkeypatch):
    """mujoco_warp computes light at each pixel, also on flat faces, and adds highlights to it."""
    monkeypatch.setattr(drawing, "_AS_OPENGL", False)


def assert_same_pictures(frames: np.ndarray, expected: np.ndarray) -> None:
    """mujoco_warp cuts levels off where `Primitives` round them, as OpenGL does."""
    difference = frames.astype(int) - expected
    assert difference.min() >= -1
    assert difference.max() <= 1
    assert (difference < 0).any(axis=-1).mean() < 0.001
    assert difference.mean() < 0.6
    assert len(np.unique(frames.reshape(-1, 3), axis=0)) > 100  # it is no empty picture


@pytest.mark.thorough
@pytest.mark.parametrize("name", ALL_TASKS)
def test_primitives_are_drawn_as_mujoco_warp_draws_them_in_every_task(
    name, monkeypatch, without_grids
):
    task, simulator = load_task(name), simulator_of(name)
    rng = np.random.default_rng(2)
    parameters = task.parameters.from_unit(rng.uniform(0, 1, (8, len(task.parameters))))
    actions = random_actions(8, 5, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(parameters, actions, rng)
    camera = task.cameras[0].camera
    expected = mujoco_warps_own(monkeypatch, simulator.model, task.parameters, camera, 84)
    states, parameters = rollouts.states[:, -1], rollouts.parameters
    assert_same_pictures(simulator.render(states, parameters), expected.render(states, parameters))


# Every shape in every material, every kind of light, and what must not be seen.
PRIMITIVES = """
<mujoco>
  <visual><headlight ambient=".2 .1 .2" diffuse=".3 .3 .3" specular=".5 .5 .5"/></visual>
  <asset>
    <texture name="checks" type="2d" builtin="checker" rgb1=".9 .5 .2" rgb2=".1 .3 .6"
             mark="random" random=".1" width="50" height="40"/>
    <texture name="cube" type="cube" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="8"
             height="48"/>
    <material name="checks" texture="checks" texrepeat="3 2" texuniform="true" specular="1"
              shininess=".1"/>
    <material name="glowing" texture="checks" emission=".3" specular="0"/>
    <material name="cube" texture="cube" rgba=".8 .9 1 1" shininess="0"/>
    <material name="glass" rgba="1 1 1 0"/>
  </asset>
  <worldbody>
    <light type="directional" dir=".3 0 -1" diffuse=".3 .2 .2" ambient=".1 0 0"/>
    <light type="spot" pos="0 -1 2" dir="0 .5 -1" cutoff="40" exponent="5" attenuation="1 0 .1"/>
    <light type="point" pos="1 -1 1" diffuse=".3 .3 .3" attenuation=".5 .2 0"/>
    <light pos="0 0 3" active="false"/>
    <camera name="above" pos="0 -2 2" xyaxes="1 0 0 0 1 1.2" fovy="60"/>
    <geom name="ground" type="plane" size="1.8 1 1" material="checks"/>
    <geom type="plane" size="0 0 1" pos="0 0 -.3" material="glowing"/>
    <geom type="sphere" pos="0 -.9 .1" size=".2" rgba=".2 .6 .3 .5"/>
    <geom name="hidden" type="box" pos="0 -.6 1" size=".3 .2 .2" rgba="1 1 1 0"/>
    <geom name="glass" type="box" pos="0 -.6 1" size=".3 .2 .2" material="glass"/>
    <geom name="of another group" type="box" pos="0 -.6 1" size=".3 .2 .2" group="4"/>
    <geom name="around the camera" type="box" pos="0 -2 2" size=".2 .2 .2"/>
    {geoms}
  </worldbody>
</mujoco>
"""
SIZES = {
    "plane": ".15 .1 .1",
    "sphere": ".15",
    "capsule": ".06 .1",
    "ellipsoid": ".05 .1 .15",
    "cylinder": ".1 .12",
    "box": ".12 .1 .06",
}


def test_every_primitive_is_drawn_as_mujoco_warp_draws_it(monkeypatch, without_grids):
    paints = ['rgba=".9 .7 .8 1"', *(f'material="{m}"' for m in ("checks", "glowing", "cube"))]
    geoms = "".join(
        f'<geom name="{shape} {row}" type="{shape}" size="{size}" {paint} '
        f'pos="{0.4 * column - 1} {0.4 * row - 0.5} .2" euler="{40 - 50 * row} 30 {20 * column}"/>'
        for row, paint in enumerate(paints)
        for column, (shape, size) in enumerate(SIZES.items())
    )
    model = mujoco.MjModel.from_xml_string(PRIMITIVES.format(geoms=geoms))
    space = ParameterSpace(colour("box", ("box 3",), (0.5, 0.5, 0.5)))
    states = initial_state(model).repeat(2, axis=0)
    parameters = np.array([[0.5, 0.5, 0.5], [0.9, 0.2, 0.1]])
    frames = Raycaster(model, space, ABOVE, PictureSettings(image_size=96)).render(
        states, parameters
    )
    assert (frames[0] != frames[1]).any()
    expected = mujoco_warps_own(monkeypatch, model, space, "above", 96)
    assert_same_pictures(frames, expected.render(states, parameters))


# --- the camera's parameters ----------------------------------------------------------------


def camera_space(name: str) -> ParameterSpace:
    """A task's parameters, a delay that no picture shows, and its camera's pose and view."""
    task = load_task(name)
    model = task.load_model()
    camera = model.camera(task.cameras[0].camera)
    names = tuple(model.actuator(i).name for i in range(model.nu))
    return ParameterSpace(
        [
            *task.parameters,
            delay("late", names, 0.05),
            *camera_pose("camera", task.cameras[0].camera, tuple(camera.pos), within_m=0.3),
            field_of_view("fov", task.cameras[0].camera, float(camera.fovy[0])),
        ]
    )


@functools.lru_cache(maxsize=1)
def filmed_otherwise(name: str) -> tuple[Simulator, np.ndarray, np.ndarray]:
    """A simulator, and 8 states of worlds with parameters: cameras all over their ranges."""
    task, space = load_task(name), camera_space(name)
    simulator = replace(task, parameters=space).simulator(image_size=84)
    rng = np.random.default_rng(3)
    parameters = np.tile(space.nominal, (8, 1))
    is_camera = [p.field.startswith("cam_") or p.is_delay for p in space]
    drawn = space.from_unit(rng.uniform(0, 1, parameters.shape))
    parameters[:, is_camera] = drawn[:, is_camera]
    actions = random_actions(8, 6, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(parameters, actions, rng)
    return simulator, rollouts.states[:, -1], rollouts.parameters


def test_a_camera_of_other_pose_and_view_is_drawn_by_us_as_by_mujoco_warp(
    monkeypatch, without_grids
):
    """All in one: moved, turned and zoomed, with a sky that turns and a remembering model."""
    simulator, states, parameters = filmed_otherwise("walker")
    with monkeypatch.context() as patch:
        patch.setattr(mujoco_warp, "render", lambda *_: pytest.fail("not by us"))
        frames = simulator.render(states, parameters)
    expected = mujoco_warps_own(monkeypatch, simulator.model, simulator.space, "side", 84)
    assert_nearly_same_pictures(frames, expected.render(states, parameters))


def assert_nearly_same_pictures(frames: np.ndarray, expected: np.ndarray) -> None:
    """But for the few pixels at edges that rounding errors decide."""
    difference = np.abs(frames.astype(int) - expected).max(axis=-1)
    assert (difference > 2).mean() < 0.002
    assert len(np.unique(frames.reshape(-1, 3), axis=0)) > 100


@pytest.mark.parametrize("parameter", ["camera_x", "camera_pitch", "camera_roll", "fov"])
def test_the_cameras_parameters_change_the_picture(parameter):
    simulator, states, _ = filmed_otherwise("walker")
    space = simulator.space
    parameters = np.tile(space.nominal, (2, 1))
    parameters[1, space.index(parameter)] = space[parameter].high
    frames = simulator.render(states[[0, 0]], parameters).astype(int)
    assert np.abs(frames[0] - frames[1]).mean() > 1


def test_a_camera_that_only_moves_sees_the_same_sky(scene):
    """The sky is drawn once for it, as for one that stays where it is."""
    moves = camera_pose("camera", "above", (0, -1, 1))[:3]
    space = ParameterSpace([*SPACE, *moves])
    renderer = Raycaster(scene, space, ABOVE, SMALL, num_threads=1)
    parameters = np.array([[*RED, *BLUE, 0, -1, 1], [*RED, *BLUE, 0.1, -1, 0.95]])
    still, other = renderer.render(states_of(scene, [0.0, 0.0]), parameters)
    np.testing.assert_array_equal(still[:8], other[:8])
    assert (still[8:] != other[8:]).any()
    expected = Raycaster(scene, SPACE, ABOVE, SMALL, num_threads=1)
    np.testing.assert_array_equal(
        still, expected.render(states_of(scene, [0.0]), painted((RED, BLUE)))[0]
    )


def test_one_sky_is_drawn_once_and_others_for_themselves(scene):
    at = scene, "above", (SIZE, SIZE)
    assert constant_sky(*at) is constant_sky(*at)
    elsewhere, brighter = copy.copy(scene), copy.copy(scene)
    elsewhere.cam_quat[0] = 1, 0, 0, 0
    brighter.tex_data[:] = np.minimum(brighter.tex_data, 200) + 40
    for other in ((elsewhere, *at[1:]), (brighter, *at[1:])):
        assert (constant_sky(*other) != constant_sky(*at)).any()
    assert constant_sky(scene, "above", (SIZE, 2 * SIZE)).shape == (SIZE, 2 * SIZE)


def sky_faces(model: mujoco.MjModel) -> np.ndarray:
    """(6, W, W, 3) of the model's skybox."""
    is_sky = model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value
    texture = int(np.flatnonzero(is_sky)[0])
    width = model.tex_width[texture]
    texels = model.tex_data[model.tex_adr[texture] :][: 6 * width * width * 3]
    return texels.reshape(6, width, width, 3).astype(np.float32)


def test_a_turning_cameras_sky_of_one_image_is_smoothed():
    texture = '<texture type="skybox" builtin="flat" width="32" height="32"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{texture}</asset></mujoco>")
    model.tex_height[0] = 32  # as of a file with one image for all faces
    model.tex_data[:] = np.random.default_rng(0).integers(0, 256, len(model.tex_data))
    smooth = smooth_sky(model, 90 / 2).tex_data[: 32 * 32 * 3].reshape(32, 32, 3)
    assert np.ptp(smooth[:16, :16], axis=(0, 1)).max() == 0


@pytest.mark.thorough
def test_a_turning_cameras_sky_has_no_stars_smaller_than_pixels():
    model, pixel_deg = load_task("ball_in_cup").load_model(), 45 / 64
    before = sky_faces(model)
    after = sky_faces(smooth_sky(model, pixel_deg))
    np.testing.assert_array_equal(sky_faces(model), before)  # the model is left alone
    side = round(before.shape[1] * pixel_deg / 90)
    assert side > 1
    for corner in (slice(0, side), slice(-(before.shape[1] % side or side), None)):
        block = after[:, corner, corner]
        assert np.ptp(block, axis=(1, 2)).max() == 0
        mean = before[:, corner, corner].mean((1, 2))
        np.testing.assert_allclose(block[:, 0, 0], mean, atol=0.5)
    assert after.max() < before.max() - 30  # the brightest star
    np.testing.assert_array_equal(sky_faces(smooth_sky(model, 1e-3)), before)


@pytest.mark.thorough
@pytest.mark.opengl
@pytest.mark.parametrize(
    "name",
    ["walker", *(pytest.param(n, marks=pytest.mark.slow) for n in ("ball_in_cup", "cartpole"))],
)
def test_both_renderers_see_through_a_camera_of_other_pose_and_view(name):
    """Fixed and tracking cameras. Measured: 2.1 to 5.3 of 255, much of it in the sky's stars."""
    simulator, states, parameters = filmed_otherwise(name)
    drawer = opengl_or_skip(simulator.model, simulator.space, load_task(name).cameras[0].camera, 84)
    cast, drawn = (r.render(states, parameters).astype(int) for r in (simulator, drawer))
    assert np.abs(cast - drawn).mean() < 6
    thing = {"ball_in_cup": "cup"}.get(name, "body")
    channels = [simulator.space.index(f"{thing}_{channel}") for channel in "rgb"]
    dark, bright = parameters.copy(), parameters.copy()
    dark[:, channels], bright[:, channels] = 0, 1
    plain = opengl_or_skip(
        simulator.model, simulator.space, load_task(name).cameras[0].camera, 84, OpenGLQuality()
    )
    cast, drawn = (
        np.abs(r.render(states, dark).astype(int) - r.render(states, bright)).max(-1) > 40
        for r in (simulator, plain)
    )
    assert cast.sum() > 8 * 20
    assert (cast & drawn).sum() / (cast | drawn).sum() > 0.98


BALL = ParameterSpace(colour("ball", ("ball",), (0.4, 0.4, 0.4)))
MESH = """
<mujoco>
  <asset><mesh name="tetrahedron" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset>
  <worldbody>
    <camera name="above" pos="0 0 4"/>
    <geom name="ball" pos=".7 0 0" size=".3"/>
    <geom type="mesh" mesh="tetrahedron" pos="-.7 0 0"/>
  </worldbody>
</mujoco>
"""
FLEX = """
<mujoco>
  <worldbody>
    <camera name="above" pos="0 0 4"/>
    <geom name="ball" pos=".7 0 0" size=".3"/>
    <flexcomp name="cloth" type="grid" dim="2" count="3 3 1" spacing=".4 .4 .4" radius=".01"
              pos="-.7 0 0"/>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("xml", [MESH, FLEX], ids=["mesh", "flex"])
def test_models_with_meshes_or_flexes_are_drawn_by_mujoco_warp(xml, monkeypatch):
    monkeypatch.setattr(Primitives, "__init__", lambda *_: pytest.fail("it is drawn by us"))
    Raycaster(mujoco.MjModel.from_xml_string(xml), BALL, ABOVE, SMALL)


def test_a_flex_is_drawn_at_its_place_in_the_picture():
    model = mujoco.MjModel.from_xml_string(FLEX)
    renderer = Raycaster(model, BALL, ABOVE, SMALL, num_threads=1)
    frame = renderer.render(initial_state(model), BALL.nominal[None])[0]
    columns = (frame > 0).any(axis=(0, 2))
    assert columns[SIZE // 2 :].any()  # the ball
    assert columns[: SIZE // 2].any()


UNKNOWN_TO_WARP = """
<mujoco>
  <option solver="PGS"><flag midphase="disable"/></option>
  <worldbody>
    <camera name="above" pos="0 0 4"/>
    <body><joint name="turn" type="{}"/><geom name="ball" pos=".7 0 0" size=".3"/></body>
  </worldbody>
  <actuator>{}</actuator>
</mujoco>
"""


def test_physics_that_warp_lacks_is_not_needed_to_draw():
    xml = UNKNOWN_TO_WARP.format("hinge", '<pid joint="turn" kp="1" input="pos vel"/>')
    plain = mujoco.MjModel.from_xml_string(UNKNOWN_TO_WARP.format("hinge", ""))
    models = (mujoco.MjModel.from_xml_string(xml), plain)
    first, second = (
        Raycaster(model, BALL, ABOVE, SMALL, num_threads=1).render(
            initial_state(model), BALL.nominal[None]
        )
        for model in models
    )
    assert first.any()
    np.testing.assert_array_equal(first, second)


def test_a_model_that_warp_refuses_is_refused_in_a_line():
    xml = UNKNOWN_TO_WARP.format("ball", '<orientation joint="turn" kp="1"/>')
    with pytest.raises(InputError, match=r"cannot draw the model, since MuJoCo Warp .*mjTRN_SO3"):
        Raycaster(mujoco.MjModel.from_xml_string(xml), BALL, ABOVE, SMALL)


@pytest.mark.parametrize("geom", ["", '<geom size=".1" group="3"/>'])
def test_a_model_of_which_nothing_is_seen_is_refused_in_a_line(geom):
    """mujoco_warp would end the process."""
    xml = f'<mujoco><worldbody><camera name="above" pos="0 0 4"/>{geom}</worldbody></mujoco>'
    space = ParameterSpace([])
    with pytest.raises(InputError, match=r"nothing can be drawn: .* in the groups 0 to 2"):
        Raycaster(mujoco.MjModel.from_xml_string(xml), space, ABOVE, SMALL)


def test_depths_are_of_geoms_alone():
    """A ball of .3 m at .7 m to the right, 4 m below the camera; the cloth is not there."""
    model = mujoco.MjModel.from_xml_string(FLEX)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    poses = (data.geom_xpos, data.geom_xmat.reshape(-1, 3, 3), data.cam_xpos[0], np.eye(3))
    places = (np.repeat(pose[None], 20, 0) for pose in poses)  # more than a launch
    drawn = Depths(model, "above", (SIZE, SIZE), np.ones(1, bool))
    geoms, depths = drawn.draw(*places, 60.0)
    column = round(SIZE / 2 + SIZE / 2 / np.tan(np.pi / 6) * 0.7 / 4)
    assert (geoms[:, SIZE // 2, column] == 0).all()
    np.testing.assert_allclose(depths[:, SIZE // 2, column], 4 - 0.3, atol=0.02)
    assert (geoms[:, :, : SIZE // 2] == -1).all()


@pytest.mark.thorough
@pytest.mark.opengl
@pytest.mark.parametrize("name", ALL_TASKS)
def test_both_renderers_draw_the_same_pictures_of_every_task(name):
    """Measured: 1.7 to 3.5 of 255 with shadows, 2.0 to 4.0 as dm_control draws.

    What differs are shadows, jagged edges, reflections, and how the sky's stars are averaged.
    """
    task, simulator = load_task(name), simulator_of(name)
    space = task.parameters
    rng = np.random.default_rng(0)
    parameters = space.from_unit(rng.uniform(0.3, 0.7, (4, len(space))))
    actions = random_actions(4, 10, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(parameters, actions, rng)
    states, parameters = rollouts.states[:, [0, -1]].reshape(8, -1), np.repeat(parameters, 2, 0)
    cast = simulator.render(states, parameters).astype(int)
    for quality, most in ((SHADOWS, 4.5), (OPENGL_DM_CONTROL, 5)):
        drawer = opengl_or_skip(simulator.model, space, task.cameras[0].camera, 84, quality)
        difference = cast - drawer.render(states, parameters)
        assert np.abs(difference).mean() < most
        assert np.abs(difference.mean(axis=(0, 1, 2))).max() < 3  # no brighter, no other tint


LAMPS = """
<mujoco>
  <visual><headlight ambient=".2 .2 .2" diffuse="0 0 0" specular="0 0 0"/></visual>
  <asset><texture name="grid" type="2d" builtin="flat" rgb1=".9 .7 .5" width="8" height="8"/>
  <material name="tiles" texture="grid" texrepeat=".5 .8" texuniform="true" specular="0"/>
  <material name="plain" rgba=".7 .5 .6 1" specular="0"/></asset>
  <statistic extent="{extent}"/>
  <worldbody>
    <light pos=".3 .2 1.5" dir=".1 .1 -1" diffuse=".6 .6 .6" specular="0 0 0" castshadow="false"/>
    <light pos="-1.2 .4 .8" dir=".4 0 -1" diffuse=".3 .2 .2" specular="0 0 0" cutoff="60"
           attenuation=".5 .3 .2" exponent="3" castshadow="false"/>
    <camera name="front" pos=".4 -3 2" xyaxes="1 0 0 0 .55 .83" fovy="50"/>
    {floor}
  </worldbody>
</mujoco>
"""


@pytest.mark.opengl
@pytest.mark.parametrize(
    ("floor", "extent"),
    [
        ('<geom name="floor" type="plane" size="4 3 .7" material="plain"/>', 1),
        ('<geom name="floor" type="plane" size="5 1.5 .9" material="plain" pos=".2 .1 0"/>', 1),
        ('<geom name="floor" type="plane" size="0 0 .1" material="tiles"/>', 2),
        ('<geom name="floor" type="plane" size="0 3 .8" material="plain" euler="0 0 20"/>', 3),
        ('<geom name="floor" type="box" size="2 1.5 .1" material="plain" euler="3 0 30"/>', 1),
    ],
)
def test_lamps_light_flat_faces_as_in_opengl(floor, extent):
    """OpenGL computes light at the lines of a grid, which a lamp's cone may be narrower than."""
    model = mujoco.MjModel.from_xml_string(LAMPS.format(floor=floor, extent=extent))
    space = ParameterSpace(colour("floor", ("floor",), (0.6, 0.6, 0.6)))
    states, worlds = initial_state(model).repeat(2, 0), np.array([[0.7, 0.5, 0.6]] * 2)
    # The second picture: MuJoCo moves endless planes to where the camera was before.
    drawn = opengl_or_skip(model, space, "front", 64, OpenGLQuality()).render(states, worlds)[1]

    def off() -> float:
        settings = PictureSettings(image_size=64)
        cast = Raycaster(model, space, View("front"), settings).render(states, worlds)[1]
        difference = np.abs(cast.astype(int) - drawn).max(-1)
        return float(np.quantile(difference, 0.98))  # but for edges

    lit = drawn.astype(int).sum(-1)
    assert np.ptp(lit[lit > 0]) > 40  # the lamps are seen
    assert off() <= 1
    with pytest.MonkeyPatch.context() as patch:  # light at each pixel would be another
        patch.setattr(drawing, "_AS_OPENGL", False)
        assert off() > 10


@pytest.mark.thorough
@pytest.mark.opengl
@pytest.mark.parametrize("name", ALL_TASKS)
def test_both_renderers_put_the_robot_at_the_same_pixels(name):
    """The silhouettes of what parameters paint: the pixels that each colour changes."""
    task, simulator = load_task(name), simulator_of(name)
    space = task.parameters
    rng = np.random.default_rng(1)
    nominal = np.tile(space.nominal, (6, 1))
    actions = random_actions(6, 10, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(nominal, actions, rng)
    states = rollouts.states[:, -1]
    drawer = opengl_or_skip(simulator.model, space, task.cameras[0].camera, 84, OpenGLQuality())
    sizes = []
    for thing in painted_by(task):
        channels = [space.index(f"{thing}_{channel}") for channel in "rgb"]
        dark, bright = nominal.copy(), nominal.copy()
        dark[:, channels], bright[:, channels] = 0, 1
        cast, drawn = (
            np.abs(r.render(states, dark).astype(int) - r.render(states, bright)).max(-1) > 40
            for r in (simulator, drawer)
        )
        sizes.append(cast.sum())
        assert sizes[-1] > 6 * 8, thing
        assert (cast ^ drawn).sum() <= 0.02 * (cast | drawn).sum(), thing
    assert max(sizes) > 6 * 20


@pytest.mark.opengl
def test_opengl_draws_the_string_that_the_ray_caster_cannot():
    task = load_task("ball_in_cup")
    model = task.load_model()
    bare = task.load_model()
    bare.tendon_group[:] = 5  # of those not shown
    data = mujoco.MjData(model)
    data.qpos[model.joint("ball_x").qposadr[0]] = 0.2  # out of the cup
    state = np.empty((1, mujoco.mj_stateSize(model, STATE)))
    mujoco.mj_getState(model, data, state[0], STATE)
    with_string, without = (
        opengl_or_skip(m, task.parameters, task.cameras[0].camera, 84).render(
            state, task.parameters.nominal[None]
        )
        for m in (model, bare)
    )
    assert (with_string != without).any()


@pytest.mark.opengl
def test_opengl_renderers_do_not_disturb_one_another(scene):
    first = opengl_or_skip(scene, SPACE, "above", SIZE)
    before = draw_one(first, scene, RED, BLUE)
    other = opengl_or_skip(scene, SPACE, "above", 2 * SIZE, OPENGL_DM_CONTROL)
    draw_one(other, scene, BLUE, RED)
    np.testing.assert_array_equal(draw_one(first, scene, RED, BLUE), before)
    del other
    np.testing.assert_array_equal(draw_one(first, scene, RED, BLUE), before)


def test_opengl_that_is_not_installed_is_refused_with_what_to_install(scene, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(opengl, "find_library", lambda name: None)
    with pytest.raises(InputError, match=r"apt install libegl1.*raycaster") as error:
        make_renderer(scene, SPACE, ABOVE, replace(SMALL, renderer="opengl"))
    assert "\n" not in str(error.value)


def test_a_context_that_mujoco_cannot_draw_in_is_refused_and_freed(scene, monkeypatch):
    freed = []
    without_display = SimpleNamespace(free=lambda: freed.append(True))
    monkeypatch.setattr(opengl, "_make_gl_context", lambda *size: without_display)

    def fail(*_):
        raise mujoco.FatalError("no OpenGL platform library")

    monkeypatch.setattr(mujoco, "MjrContext", fail)
    with pytest.raises(InputError, match=r"no OpenGL platform library; install.*raycaster"):
        make_renderer(scene, SPACE, ABOVE, replace(SMALL, renderer="opengl"))
    assert freed == [True]


def test_an_unknown_renderer_or_camera_is_refused(scene):
    with pytest.raises(InputError, match="no renderer 'povray'"):
        make_renderer(scene, SPACE, ABOVE, replace(SMALL, renderer="povray"))
    with pytest.raises(InputError, match="no camera 'below'"):
        make_renderer(scene, SPACE, View("below"), SMALL)


@pytest.mark.opengl
def test_a_camera_with_a_sensor_shows_the_square_of_its_field_of_view():
    """Of 4:3, which is not squeezed into the square."""
    sensor = 'resolution="640 480" sensorsize=".008 .006" focal=".006 .006"'
    pictures = []
    for lens in (sensor, f'fovy="{2 * np.degrees(np.arctan(0.5))}"'):
        text = SCENE.replace('<camera name="above"', f'<camera name="above" {lens}')
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        row = np.empty((1, mujoco.mj_stateSize(model, STATE.value)))
        mujoco.mj_getState(model, data, row[0], STATE.value)
        drawer = opengl_or_skip(model, SPACE, "above", SIZE)
        pictures.append(drawer.render(row, SPACE.nominal[None])[0].astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 2
