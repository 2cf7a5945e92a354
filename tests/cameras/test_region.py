"""A region of interest: what a tuning file's camera looks at, as a camera of its own sees it."""

import numpy as np
import pytest

from simtune.cameras.distortion import distort
from simtune.cameras.views import View
from simtune.config import RecordConfig
from simtune.errors import InputError
from simtune.filming import filming_whole
from simtune.filming.cameras import _aspect
from simtune.simulation import Simulator
from simtune.tasks import Task

SCENE = """
<mujoco>
  <compiler angle="degree"/>
  <visual><headlight ambient=".4 .4 .4" diffuse="0 0 0" specular="0 0 0"/></visual>
  <worldbody>
    <light pos="0 0 4"/>
    <camera name="above" pos=".2 -.3 4" euler="8 -5 12" fovy="50"/>
    <geom name="table" type="box" size="3 3 .1" pos="0 0 -1" rgba=".2 .7 .3 1"/>
    <geom name="mat" type="box" size=".3 .3 .1" pos="-.8 .9 -.8" rgba="0 0 1 1"/>
    <body name="arm" pos="-.6 .4 0">
      <joint name="x" type="slide"/>
      <geom name="ball" size=".3" rgba="1 .2 .1 1"/>
      <camera name="wrist" pos="0 0 2" xyaxes="1 .1 0 0 1 .2"/>
    </body>
  </worldbody>
</mujoco>
"""
TUNING = """model = "scene.xml"
control_timestep_s = 0.02
[camera]
{camera}
[[parameters]]
name = "mass"
kind = "mass"
objects = "arm"
"""
POSED = "position_m = [0.3, 0.2, 4]\nlook_at_m = [0, 0, 0]\nfield_of_view_deg = 50"
REGION = "region = { left = 60, top = 40, right = 200, bottom = 145, width = 320, height = 240 }"
BARREL = (
    "intrinsics = { fx = 260, fy = 260, cx = 160, cy = 118, width = 320, height = 240 }\n"
    "distortion = [-0.2, 0.03, 0.001, -0.002, 0]"
)
POSED_LENS = POSED.rpartition("\n")[0] + "\n" + BARREL
LENS_REGION = "region = { left = 60, top = 40, right = 200, bottom = 145 }"
HIGH, WIDE, SIZE = 240, 320, 30


@pytest.fixture
def scene(folder):
    (folder / "scene.xml").write_text(SCENE)
    return folder


def simulator(task: Task, size: int, aspect: float) -> Simulator:
    return task.simulator(image_size=size, views=[View(task.cameras[0].camera, aspect)])


def drawn(task: Task, size: int, aspect: float) -> np.ndarray:
    """(size, width, 3) of the scene at rest."""
    its, rng = simulator(task, size, aspect), np.random.default_rng(0)
    nominal = its.space.nominal[None]
    rest = its.roll_out(nominal, np.zeros((1, 0, its.num_actions)), rng).states[:, 0]
    return its.render(rest, nominal)[0]


@pytest.mark.parametrize("camera", [POSED, 'camera = "above"', 'camera = "wrist"'])
def test_what_is_read_of_a_region_is_what_its_camera_sees(scene, load, camera):
    whole = drawn(load(TUNING.format(camera=camera)), HIGH, WIDE / HIGH)
    task = load(TUNING.format(camera=f"{camera}\n{REGION}"))
    aspect = task.cameras[0].aspect(whole.shape)
    assert aspect == pytest.approx(140 / 105, rel=0.03)
    expected = drawn(task, 4 * SIZE, aspect)  # without jagged edges
    height, width = SIZE, int(SIZE * aspect + 1e-6)
    expected = expected[:, : 4 * width].reshape(height, 4, width, 4, 3).mean((1, 3))
    read = task.cameras[0].as_pinhole(whole, (height, width))
    difference = np.abs(read - expected)
    assert difference.mean() < 4
    assert np.ptp(expected, (0, 1)).max() > 60  # there is something to see
    elsewhere = task.cameras[0].as_pinhole(np.roll(whole, 6, 1), (height, width))
    assert np.abs(elsewhere - expected).mean() > 1.5 * difference.mean()


@pytest.mark.parametrize("camera", [POSED, 'camera = "above"', 'camera = "wrist"'])
def test_what_is_filmed_of_a_region_is_the_whole_picture(scene, load, camera):
    """So that whoever reads the film looks at the region once, and not at a region of it."""
    whole = drawn(load(TUNING.format(camera=camera)), SIZE, WIDE / HIGH)
    task = filming_whole(load(TUNING.format(camera=f"{camera}\n{REGION}")))
    filmed = drawn(task, SIZE, WIDE / HIGH).astype(int)
    assert np.abs(filmed - whole).mean() < 0.5
    config = RecordConfig(task="scene.toml", out=scene / "out", image_size=SIZE)
    assert _aspect(config, task.cameras[0].lens) == pytest.approx(WIDE / HIGH)


def test_a_lens_is_not_filmed_through(scene, load):
    with pytest.raises(InputError, match="has a lens, and pictures are drawn without one"):
        filming_whole(load(TUNING.format(camera=f"{POSED_LENS}\n{LENS_REGION}")))


def test_a_region_behind_a_lens_has_the_directions_of_its_pixels(scene, load):
    lens = (
        load(
            TUNING.format(
                camera=f"{POSED}\n{LENS_REGION}".replace("\nfield_of_view_deg = 50", "\n" + BARREL)
            )
        )
        .cameras[0]
        .lens
    )
    middle = lens.turn.apply([0, 0, 1])
    focal, centre = [lens.fx, lens.fy], [lens.cx, lens.cy]
    seen = distort(lens.distortion, middle[:2] / middle[2]) * focal + centre
    np.testing.assert_allclose(seen + 0.5, [130, 92.5], atol=1e-4)
    half_width, half_height = lens.half_sides
    for right, down, side, pixel in ((1, 0, 0, (60, 200)), (0, 1, 1, (40, 145))):
        # One of both sides ends at the region's edge, the other within it.
        ends = np.array([[s * right * half_width, s * down * half_height, 1] for s in (-1, 1)])
        ahead = lens.turn.apply(ends)
        at = distort(lens.distortion, ahead[:, :2] / ahead[:, 2:]) * focal + centre
        low, high = at[:, side] + 0.5
        assert pixel[0] - 1e-6 < low + 1e-4 < pixel[0] + 6
        assert pixel[1] - 6 < high - 1e-4 < pixel[1] + 1e-6
        assert min(abs(low - pixel[0]), abs(high - pixel[1])) < 0.2


@pytest.mark.parametrize("camera", [POSED, 'camera = "above"'])
def test_a_camera_is_turned_once_however_often_its_model_is_exported(scene, load, camera):
    text = TUNING.format(camera=f"{camera}\n{REGION}")
    first = load(text)
    (scene / "scene.xml").write_text(first.load_spec().to_xml())
    again = load(text)
    name = first.cameras[0].camera
    its, other = (task.load_model().camera(name) for task in (first, again))
    np.testing.assert_allclose(other.quat, its.quat, atol=1e-5)
    assert other.fovy == pytest.approx(its.fovy, abs=1e-4)
    assert again.cameras[0].lens.fx == pytest.approx(first.cameras[0].lens.fx, rel=1e-6)


@pytest.mark.parametrize(
    ("camera", "line", "message"),
    [
        (f"{POSED}\n{LENS_REGION}", 7, "width"),
        (f"{POSED}\n{REGION.replace('200', '340')}", 7, "not within the picture of 320×240"),
        (f"{POSED}\n{REGION.replace('200', '50')}", 7, "expected left, top, right and bottom"),
        (f"{POSED}\nregion = 3", 7, "region"),
    ],
)
def test_a_region_that_is_none_is_refused(scene, refuses, camera, line, message):
    refuses(TUNING.format(camera=camera), line, message)


def test_a_camera_that_turns_by_itself_has_no_region(scene, load):
    (scene / "scene.xml").write_text(SCENE.replace('name="above"', 'name="above" mode="trackcom"'))
    with pytest.raises(ValueError, match="turns by itself"):
        load(TUNING.format(camera=f'camera = "above"\n{REGION}'))


def test_a_turned_camera_can_be_turned_back(scene, load):
    task = load(TUNING.format(camera=f"{POSED}\n{REGION}"))
    lens, own = task.cameras[0].lens, load(TUNING.format(camera=POSED)).load_model()
    turned = task.load_model().camera("simtune_camera").quat
    whole = own.camera("simtune_camera").quat
    assert np.abs(turned - whole).max() > 0.05
    np.testing.assert_allclose(lens.from_region(turned), whole, atol=1e-9)
