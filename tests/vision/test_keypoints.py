"""Keypoints: where points of moving geoms appear, against plain loops and against pictures."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from simtune.cameras.views import View
from simtune.parameters import (
    ModelWriter,
    ParameterSpace,
    camera_pose,
    colour,
    field_of_view,
)
from simtune.randomization import Distribution
from simtune.simulation import PictureSettings, Simulator
from simtune.simulation.rendering.renderer import make_renderer
from simtune.simulation.worlds import Worlds
from simtune.tasks import TASKS, load_any_task, load_task
from simtune.vision.keypoints import (
    _project,
    candidate_keypoints,
    choose_keypoints,
    find_keypoints,
    is_drawn,
)

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SIZE = 64  # pixels

BALL = """
<mujoco>
  <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="oblique" pos="0.3 -2 0.9" xyaxes="1 0.2 0.1 -0.1 0.3 1" fovy="38"/>
    <geom name="floor" type="plane" size="5 5 .1" pos="0 0 -3" rgba="0 0 0 1"/>
    <body>
      <freejoint/>
      <geom name="ball" type="sphere" size=".05" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""
BALL_SPACE = ParameterSpace(colour("ball", ("ball",), (1.0, 0.0, 0.0)))


def start_worlds(name: str, num_worlds: int) -> tuple[Worlds, np.ndarray]:
    """Worlds of a task after a few steps, and their parameters."""
    task = load_task(name)
    worlds = Worlds(task.load_model(), task.parameters, num_worlds)
    rng = np.random.default_rng(0)
    uniform = rng.uniform(0.3, 0.7, (num_worlds, len(task.parameters)))
    parameters = task.parameters.from_unit(uniform)
    worlds.batch.bind("geom_xpos")
    for field in ("geom_xmat", "cam_xpos", "cam_xmat"):
        worlds.batch.bind(field)
    worlds.reset(parameters, task.initialize, rng)
    for _ in range(5):
        worlds.step(rng.uniform(-1, 1, (num_worlds, worlds.batch.model.nu)), 10)
    return worlds, parameters


def project_by_hand(model, data, camera: int, point: np.ndarray) -> tuple[float, float]:
    """Pixel coordinates of a point in the world, for a SIZE × SIZE picture."""
    right, up, back = (data.cam_xmat[camera].reshape(3, 3)[:, i] for i in range(3))
    to_point = point - data.cam_xpos[camera]
    depth = -to_point @ back
    half_height = depth * np.tan(np.radians(model.cam_fovy[camera]) / 2)  # m seen above the axis
    x = (to_point @ right / half_height + 1) / 2 * SIZE - 0.5  # 0 is the first pixel's centre
    y = (1 - to_point @ up / half_height) / 2 * SIZE - 0.5
    return tuple(float(np.clip(v, 0.5, SIZE - 1.5)) for v in (x, y))


@pytest.mark.parametrize("name", list(TASKS))
def test_projection_is_that_of_a_plain_loop(name):
    task = load_task(name)
    worlds, parameters = start_worlds(name, 3)
    keypoints = candidate_keypoints(worlds.batch.model, [View(task.cameras[0].camera)], SIZE)
    pixels = keypoints.observe(worlds.batch)
    assert pixels.shape == (3, 2 * len(keypoints))
    assert pixels.dtype == np.float32
    model = task.load_model()
    camera = model.camera(task.cameras[0].camera).id
    data = mujoco.MjData(model)
    writer = ModelWriter(task.parameters, model)  # which takes the model for the nominal one
    for world in range(3):
        writer.write(model, parameters[world])
        mujoco.mj_setState(model, data, worlds.state[world], STATE)
        mujoco.mj_forward(model, data)
        expected = []
        for geom, offset in zip(keypoints.geoms, keypoints.offsets, strict=True):
            point = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ offset
            expected += project_by_hand(model, data, camera, point)
        np.testing.assert_allclose(pixels[world], expected, atol=1e-3)


def test_keypoints_are_where_the_picture_shows_them():
    model = mujoco.MjModel.from_xml_string(BALL)
    batch = Batch(model, 6)
    for field in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat"):
        batch.bind(field)
    rng = np.random.default_rng(2)
    batch.reset()
    batch.qpos[:, :3] = rng.uniform([-0.3, -0.3, 0.2], [0.4, 0.3, 0.7], (6, 3))
    batch.forward()
    keypoints = candidate_keypoints(model, [View("oblique")], SIZE)
    assert keypoints.geoms.tolist() == [model.geom("ball").id]
    renderer = make_renderer(model, BALL_SPACE, View("oblique"), PictureSettings(image_size=SIZE))
    frames = renderer.render(batch.state, np.tile(BALL_SPACE.nominal, (6, 1)))
    red = frames[..., 0].astype(float) * (frames[..., 0] > 100)
    weight = red / red.sum((1, 2), keepdims=True)
    axis = np.arange(SIZE)
    centroid = np.stack([weight.sum(1) @ axis, weight.sum(2) @ axis], -1)
    assert (np.ptp(centroid, axis=0) > 5).all()  # the balls are in different places
    np.testing.assert_allclose(keypoints.observe(batch), centroid, atol=0.4)


def test_keypoints_follow_a_camera_of_another_pose_and_field_of_view():
    """Against pictures: each world has its own camera, and the ball stays where it is."""
    model = mujoco.MjModel.from_xml_string(BALL)
    camera = [
        *camera_pose("camera", "oblique", (0.3, -2, 0.9), within_m=0.2, within_rad=0.1),
        field_of_view("fov", "oblique", 38),
    ]
    space = ParameterSpace([*BALL_SPACE, *camera])
    rng = np.random.default_rng(0)
    parameters = np.tile(space.nominal, (12, 1))
    parameters[:, 3:] = space.from_unit(rng.uniform(0, 1, (12, len(space))))[:, 3:]
    worlds = Worlds(model, space, 12)
    for field in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat"):
        worlds.batch.bind(field)

    def start(batch, rng):
        batch.qpos[:, :3] = 0.1, 0, 0.5

    worlds.reset(parameters, start, rng)
    frames = make_renderer(model, space, View("oblique"), PictureSettings(image_size=SIZE)).render(
        worlds.state, parameters
    )
    red = frames[..., 0].astype(float) * (frames[..., 0] > 100)
    weight = red / red.sum((1, 2), keepdims=True)
    axis = np.arange(SIZE)
    centroid = np.stack([weight.sum(1) @ axis, weight.sum(2) @ axis], -1)
    assert (np.ptp(centroid, axis=0) > 15).all()
    keypoints = candidate_keypoints(model, [View("oblique")], SIZE)
    np.testing.assert_allclose(keypoints.observe(worlds.batch), centroid, atol=0.4)


def test_what_is_out_of_the_picture_is_put_just_within_its_edge():
    # right, above, below left, and behind the camera
    seen = np.array([[[9, 0, -1]], [[0, 9, -1]], [[-9, -9, -1]], [[0.1, 0.0, 5]]], float)
    pixels = _project(seen, np.full(4, SIZE / 2), SIZE, SIZE)[:, 0]
    middle = (SIZE - 1) / 2
    last = SIZE - 1.5
    expected = [[last, middle], [middle, 0.5], [0.5, last], [last, middle]]
    np.testing.assert_allclose(pixels, expected)
    assert np.isfinite(_project(np.zeros((1, 1, 3)), np.full(1, 32.0), SIZE, SIZE)).all()


def test_geoms_that_never_move_are_no_keypoints():
    model = load_task("cartpole").load_model()
    keypoints = candidate_keypoints(model, [View("fixed")], SIZE)
    names = [model.geom(geom).name for geom in keypoints.geoms]
    assert set(names) == {"cart", "pole_1"}
    assert names.count("pole_1") == 3  # its centre and its two ends
    ends = keypoints.offsets[[n == "pole_1" for n in names]]
    length = model.geom("pole_1").size[1]
    np.testing.assert_allclose(ends, [[0, 0, -length], [0, 0, 0], [0, 0, length]])


@pytest.mark.parametrize(
    ("geom", "expected"),
    [
        ('material="clear"', False),
        ('material="clear" rgba=".2 .3 .4 1"', True),  # a colour of its own comes first
        ('material="red"', True),
        ('rgba="1 0 0 0"', False),
        ('group="3"', False),
    ],
)
def test_what_a_material_hides_is_not_drawn(geom, expected):
    materials = '<material name="clear" rgba="0 0 0 0"/><material name="red" rgba="1 0 0 1"/>'
    world = f'<worldbody><geom size=".1" {geom}/></worldbody>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{materials}</asset>{world}</mujoco>")
    assert is_drawn(model).tolist() == [expected]


def test_what_is_not_drawn_has_no_keypoints():
    """Such as a hand's target, or the shapes that only touch."""
    clear, touching = '<geom size=".1" rgba="0 0 0 0"/>', '<geom size=".1" group="3"/>'
    shown = '<geom name="shown" size=".1"/>'
    moving = (clear, touching, clear + shown + touching)
    bodies = "".join(f'<body><joint type="slide"/>{geoms}</body>' for geoms in moving)
    camera = '<camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>'
    world = f"<mujoco><worldbody>{camera}{bodies}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(world)
    keypoints = candidate_keypoints(model, [View("front")], SIZE)
    assert [model.geom(geom).name for geom in keypoints.geoms] == ["shown"]


def test_a_sphere_has_only_its_centre():
    model = load_task("ball_in_cup").load_model()
    keypoints = candidate_keypoints(model, [View("cam0")], SIZE)
    assert keypoints.geoms.tolist().count(model.geom("ball").id) == 1


def test_few_keypoints_that_explain_all_are_chosen():
    rng = np.random.default_rng(0)
    hidden = rng.normal(0, 8, (200, 2, 2))  # two points move, in x and y
    mixing = np.array([[1, 0], [0, 1], [0.5, 0.5], [0.3, 0.7], [0, 0]])  # the last never moves
    seen = np.einsum("lk,skc->slc", mixing, hidden) + 30
    chosen = choose_keypoints(seen)
    assert sorted(chosen) == [0, 1]
    # All others follow from the chosen: least squares leaves nothing.
    basis = (seen - seen.mean(0))[:, chosen].reshape(200, -1)
    rest = (seen - seen.mean(0)).reshape(200, -1)
    rest = rest - basis @ np.linalg.lstsq(basis, rest, rcond=None)[0]
    assert np.sqrt(np.square(rest).mean()) < 1e-9


def test_at_most_so_many_keypoints_and_none_for_less_than_the_tolerance(monkeypatch):
    rng = np.random.default_rng(0)
    seen = rng.normal(0, 5, (500, 9, 2))
    assert sorted(choose_keypoints(seen)) == list(range(9))
    assert choose_keypoints(rng.normal(0, 0.1, (500, 9, 2))) == []
    monkeypatch.setattr("simtune.vision.keypoints._MAX_KEYPOINTS", 4)
    assert len(choose_keypoints(seen)) == 4


def test_chosen_keypoints_of_a_task_fix_all_others():
    worlds, _ = start_worlds("walker", 256)
    keypoints = candidate_keypoints(worlds.batch.model, [View("side")], SIZE)
    seen = keypoints.observe(worlds.batch).reshape(256, -1, 2)
    chosen = choose_keypoints(seen)
    assert 3 <= len(chosen) < len(keypoints)
    few = keypoints.select(chosen)
    np.testing.assert_array_equal(few.observe(worlds.batch).reshape(256, -1, 2), seen[:, chosen])
    centred = seen - seen.mean(0)
    basis, others = centred[:, chosen].reshape(256, -1), centred.reshape(256, -1)
    rest = others - basis @ np.linalg.lstsq(basis, others, rcond=None)[0]
    assert np.sqrt(np.square(rest).mean(0)).max() < 0.3


@pytest.mark.parametrize("name", ["ball_in_cup", None])
def test_the_same_keypoints_come_back_from_json(name):
    """Of a model in which nothing moves that could be seen, too."""
    still = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><camera name='cam0'/><geom size='1'/></worldbody></mujoco>"
    )
    model = load_task(name).load_model() if name else still
    keypoints = candidate_keypoints(model, [View("cam0")], SIZE)
    again = keypoints.with_state(json.loads(json.dumps(keypoints.state())))
    np.testing.assert_array_equal(again.geoms, keypoints.geoms)
    np.testing.assert_array_equal(again.offsets, keypoints.offsets)
    batch = Batch(model, 2)
    batch.expand("cam_fovy")
    for field in ("geom_xmat", "geom_xpos", "cam_xmat", "cam_xpos"):
        batch.bind(field)
    batch.forward()
    assert again.observe(batch).shape == (2, 2 * len(keypoints))


@pytest.mark.parametrize("file", ["cartpole", "examples/bouncing_ball/tune.toml"])
def test_pilots_that_all_end_early_are_said_to_diverge_if_they_are_a_models(file, monkeypatch):
    """An environment may end its episodes: then what was seen up to there is used."""
    name = file if "/" not in file else str(Path(__file__).parents[2] / file)
    task = load_any_task(name)
    simulator = task.simulator(image_size=32)
    monkeypatch.setattr("simtune.vision.keypoints.PILOT_STEPS", 320)

    def lose_all(*given, **options):
        played = play(*given, **options)
        return replace(played, lengths=np.full_like(played.lengths, 2))

    play = simulator.play
    monkeypatch.setattr(simulator, "play", lose_all)
    first = Distribution.first(task.parameters, task.parameters.nominal)
    if isinstance(simulator, Simulator):
        with pytest.raises(RuntimeError, match=r"worlds .* diverged within .* check the timestep"):
            find_keypoints(simulator, first, 0)
    else:
        assert len(find_keypoints(simulator, first, 0)) == 1
