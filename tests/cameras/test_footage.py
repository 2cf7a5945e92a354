"""Lenses, backgrounds, and what a tuning file says of them."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.cameras.distortion import distort, undistort
from simtune.cameras.footage import PLAIN, Footage
from simtune.cameras.lens import Lens
from simtune.cameras.pictures import middle_square, resize
from simtune.cameras.rectify import rectify
from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.parameters import Parameter, ParameterSpace
from simtune.recordings import Dataset, open_dataset, write_dataset
from simtune.simulation import PictureSettings
from simtune.simulation.rendering.renderer import Renderer, make_renderer
from simtune.trajectory import Trajectory

WIDE = Lens(640, 480, 500.0, 510.0, 320.0, 240.0, (-0.3, 0.1, 0.001, -0.002, -0.02))
CENTRED = {"width": 96, "height": 64, "cx": 47.5, "cy": 31.5}
SIZE = 32
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 4"/>
    <camera name="above" pos="0 0 4" fovy="40"/>
    <camera name="turning" pos="0 0 4" fovy="40" mode="targetbody" target="ball"/>
    <geom name="table" type="box" size="3 3 .1" pos="0 0 -1" rgba="0 1 0 1"/>
    <geom name="mat" type="box" size=".3 .3 .1" pos="-.8 .8 -.8" rgba="0 0 1 1"/>
    <body name="ball">
      <joint name="x" type="slide"/>
      <geom name="ball" size=".3" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""
PLATE = np.random.default_rng(0).integers(0, 256, (SIZE, SIZE, 3)).astype(np.uint8)
MASS = Parameter(
    name="mass", field="body_mass", objects=("ball",), unit="kg", nominal=1, low=0.5, high=2
)


def smooth_picture(height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[:height, :width] / height
    waves = [np.sin(7 * x), np.cos(9 * y), np.sin(5 * (x + y))]
    return np.rint(127 + 100 * np.stack(waves, -1)).astype(np.uint8)


# OpenCV 5.0.0, cv2.projectPoints
@pytest.mark.parametrize(
    ("point", "pixel"),
    [
        ([0.3, 0.2], [464.146909, 338.17459812]),
        ([-0.5, 0.4], [95.782105, 422.83634232]),
        ([0.0, -0.45], [319.7975, 23.848970846718743]),
    ],
)
def test_lens_shows_points_where_opencv_does(point, pixel):
    seen = distort(WIDE.distortion, np.array(point)) * [WIDE.fx, WIDE.fy] + [WIDE.cx, WIDE.cy]
    np.testing.assert_allclose(seen, pixel, atol=1e-6)
    back = undistort(WIDE.distortion, distort(WIDE.distortion, np.array(point)))
    np.testing.assert_allclose(back, point, atol=1e-7)


def test_lens_without_distortion_is_a_pinhole():
    lens = Lens(fx=80.0, fy=80.0, **CENTRED)
    assert lens.fovy_deg == pytest.approx(np.degrees(2 * np.arctan(32 / 80)))
    assert lens.aspect == pytest.approx(1.5)
    picture = np.random.default_rng(1).integers(0, 256, (64, 96, 3)).astype(np.uint8)
    np.testing.assert_array_equal(rectify(picture, lens, (16, 24)), resize(picture, (16, 24)))
    middle = resize(middle_square(picture), (16, 16))
    np.testing.assert_array_equal(rectify(picture, lens, (16, 16)), middle)


def test_lens_brings_directions_back_to_where_a_pinhole_sees_them():
    lens = Lens(fx=80.0, fy=80.0, **CENTRED, distortion=(-0.28, 0.02, 0.002, -0.001, 0.01))
    y, x = np.mgrid[:64, :96]
    seen = np.stack([(x - lens.cx) / lens.fx, (y - lens.cy) / lens.fy], -1)
    # The picture's colours say what direction they are seen in
    shown = undistort(lens.distortion, seen)
    picture = np.rint(128 + 150 * np.concatenate([shown, shown[..., :1]], -1)).astype(np.uint8)
    at = ((np.arange(32) + 0.5) / 16 - 1) * lens.half_sides[1]
    expected = 128 + 150 * np.stack(np.meshgrid(at, at), -1)
    found = rectify(picture, lens, (32, 32))[..., :2]
    assert np.abs(found - expected).max() <= 1.5
    assert np.abs(resize(middle_square(picture), (32, 32))[..., :2] - expected).max() > 3


def test_a_pincushions_corners_bound_what_is_used():
    lens = Lens(fx=80.0, fy=80.0, **CENTRED, distortion=(0.3, 0.0, 0.0, 0.0, 0.0))
    x, y = lens.half_sides
    assert y * (1 + 0.3 * y**2) < 32 / 80 / 1.02  # less than up to the upper and lower edge
    seen = 80 * (1 + 0.3 * (x**2 + y**2)) * np.array([x, y])
    assert (seen <= [48.01, 32.01]).all()
    assert (1.003 * seen > [48, 32]).any()


def test_a_region_in_a_corner_shows_nothing_from_beyond_the_picture():
    lens = Lens(fx=80.0, fy=80.0, **CENTRED, region=(48, 32, 96, 64))
    picture = np.full((64, 96, 3), 100, np.uint8)
    picture[-1], picture[:, -1] = 200, 200  # the last pixels, which would be smeared
    corner = rectify(picture, lens, (32, 48))[-3:, -3:, 0]
    assert corner[-1, -1] > 100
    assert (corner[:-2, :-2] == 100).all()


def test_lens_of_larger_pictures_holds_for_smaller_ones():
    large = smooth_picture(480, 640)
    half = resize(large, (240, 320))
    difference = rectify(large, WIDE, (32, 40)).astype(int) - rectify(half, WIDE, (32, 40))
    assert np.abs(difference).max() <= 3
    with pytest.raises(InputError, match=r"640×360 pixels, the lens was calibrated with 640×480"):
        rectify(large[:360], WIDE, (32, 40))
    side = Footage(name="side", key="observation.images.front", lens=WIDE)
    said = r"camera side, filmed as observation\.images\.front: .* or the video of this camera"
    with pytest.raises(InputError, match=said):
        side.as_pinhole(large[:360], (32, 40))


def test_lens_that_sees_no_whole_picture_is_refused():
    with pytest.raises(InputError, match="folds the picture's edge"):
        Lens(fx=80.0, fy=80.0, **CENTRED, distortion=(-3.0, 0.0, 0.0, 0.0, 0.0)).check()
    with pytest.raises(InputError, match="outside of the picture"):
        Lens(640, 480, 500, 500, 700, 240).check()


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        # Of a picture of 192 × 144, which would fold as well
        (
            Lens(1280, 720, 186.4, 187.3, 96.9, 71.2, (-0.244, 0.046, 0.0, 0.0, 0.0)),
            "fx of 186.4 pixels and a width of 1280 make a field of view of 148°; .* another size",
        ),
        (Lens(640, 480, 500.0, 50000.0, 320.0, 240.0), "fy of 50000 pixels and a height of 480"),
    ],
)
def test_a_focal_length_of_pictures_of_another_size_is_told(lens, message):
    with pytest.raises(InputError, match=message):
        lens.check()


def test_the_lenses_that_there_are_have_plausible_angles():
    Lens(1920, 1200, 763.0, 763.0, 959.5, 599.5).check()  # 103°: 14 mm on 24 × 36 mm
    Lens(640, 480, 1050.0, 1050.0, 319.5, 239.5).check()  # 34°
    narrow = Lens.pinhole(640, 480, fovy_deg=3)  # the model's own
    replace(narrow, region=(0, 0, 640, 480)).check()


def test_a_lens_that_folds_beyond_the_middle_and_unfolds_again_is_refused():
    """Beyond 1.05 of its axis, directions are shown again nearer to the middle, up to 1.8."""
    folding = Lens(640, 480, 440, 440, 319.5, 239.5, (-0.34, 0.01, 0, 0, 0.007))
    with pytest.raises(InputError, match="folds the picture's edge"):
        folding.check()
    replace(folding, region=(220, 140, 420, 340)).check()  # what is used does not fold
    WIDE.check()


def test_plate_of_recordings_is_what_stands_still():
    background = smooth_picture(SIZE, SIZE)
    frames = np.repeat(background[None], 40, 0)
    for t, frame in enumerate(frames):
        frame[4:12, t % SIZE : t % SIZE + 6] = 0  # passes by
    plate = Footage(background="recording").plate([frames[:15], frames[15:]], (SIZE, SIZE))
    np.testing.assert_array_equal(plate, background)
    assert PLAIN.plate([frames], (SIZE, SIZE)) is None


def test_plate_of_a_file_is_seen_as_recordings_are(tmp_path):
    from matplotlib.image import imsave

    path, picture = tmp_path / "table.png", smooth_picture(64, 96)
    imsave(path, picture)
    lens = Lens(fx=80.0, fy=80.0, **CENTRED, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    for footage in (Footage(background=path), Footage(background=path, lens=lens)):
        np.testing.assert_array_equal(
            footage.plate([], (16, 20)), footage.as_pinhole(picture, (16, 20))
        )
    with pytest.raises(InputError, match="96×64, narrower than the recordings' pictures"):
        Footage(background=path).plate([], (16, 30))
    path.write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"table\.png: cannot be read as a picture"):
        Footage(background=path).plate([], (16, 16))


def drawn(space: ParameterSpace, plate: np.ndarray | None, camera: str = "above") -> np.ndarray:
    """(SIZE, SIZE, 3) as the ray caster draws the nominal scene."""
    model = mujoco.MjModel.from_xml_string(SCENE)
    view, settings = View(camera, plate=plate), PictureSettings(image_size=SIZE)
    renderer: Renderer = make_renderer(model, space, view, settings)
    state = np.zeros((1, mujoco.mj_stateSize(model, STATE)))
    return renderer.render(state, space.nominal[None])[0].astype(int)


def test_plate_is_behind_what_moves_and_in_place_of_what_does_not():
    space = ParameterSpace([MASS])
    plain, plated = drawn(space, None), drawn(space, PLATE)
    ball = plain[..., 0] > plain[..., 1] + 30
    assert 0.02 < ball.mean() < 0.2
    np.testing.assert_array_equal(plated[ball], plain[ball])
    inside = ~ball
    np.testing.assert_array_equal(plated[inside], PLATE[inside])


def test_plate_leaves_what_a_parameter_paints():
    green = Parameter(
        name="g",
        field="geom_rgba",
        objects=("mat",),
        component=2,
        unit="",
        nominal=1,
        low=0,
        high=1,
        scale="linear",
    )
    space = ParameterSpace([MASS, green])
    plain, plated = drawn(space, None), drawn(space, PLATE)
    mat = plain[..., 2] > plain[..., 1] + 30
    assert mat.mean() > 0.01
    np.testing.assert_array_equal(plated[mat], plain[mat])


def test_plate_before_a_camera_that_moves_is_refused():
    with pytest.raises(InputError, match="'turning' moves"):
        drawn(ParameterSpace([MASS]), PLATE, "turning")


def dataset_of(folder: Path, frames: np.ndarray, **options) -> Dataset:
    actions = np.zeros((len(frames) - 1, 1), np.float32)
    episodes = [Trajectory(frames, actions, 0.1)]
    write_dataset(folder, episodes, action_names=["drive"], robot_type="sim", task="t")
    return open_dataset(folder, **options)


def test_recordings_come_through_the_lens(tmp_path):
    lens = Lens(96, 64, 80.0, 80.0, 33.0, 31.5, (-0.1, 0.0, 0.0, 0.0, 0.0))  # looks to the left
    frames = np.repeat(smooth_picture(64, 96)[None], 25, 0)
    dataset = dataset_of(tmp_path / "data", frames, image_size=16, cameras=[Footage(lens=lens)])
    read = dataset.read(0).frames
    assert read.shape == (25, 16, int(16 * lens.aspect), 3)
    expected = rectify(frames[0], lens, read.shape[1:3]).astype(int)
    assert np.abs(read - expected).max() <= 12  # of the video's compression
    plain = Footage().as_pinhole(frames[0], read.shape[1:3]).astype(int)
    assert np.abs(read - plain).max() > 30


SCENE_TOML = 'model = "scene.xml"\ncontrol_timestep_s = 0.02\n'
PARAMETER = '\n[[parameters]]\nname = "mass"\nkind = "mass"\nobjects = "ball"\n'
POSE = "position_m = [0, 0, 4]\nquat = [1, 0, 0, 0]\n"
INTRINSICS = "intrinsics = { fx = 80, fy = 80, cx = 47.5, cy = 31.5, width = 96, height = 64 }\n"


@pytest.fixture
def scene(folder):
    (folder / "scene.xml").write_text(SCENE)
    return folder


def test_tuning_file_tells_a_camera_s_footage(scene, load):
    task = load(
        SCENE_TOML + '[[cameras]]\nname = "top"\nkey = "observation.images.top"\ncamera = "above"\n'
        f'background = "recording"\n{INTRINSICS}distortion = [-0.2, 0, 0, 0, 0]\n' + PARAMETER
    )
    lens = Lens(fx=80, fy=80, **CENTRED, distortion=(-0.2, 0, 0, 0, 0))
    key = "observation.images.top"
    expected = Footage(camera="above", name="top", key=key, lens=lens, background="recording")
    assert task.cameras == (expected,)
    assert task.load_model().camera("above").fovy[0] == pytest.approx(lens.fovy_deg)
    posed = load(SCENE_TOML + "[camera]\n" + POSE + INTRINSICS + PARAMETER)
    assert posed.load_model().camera(posed.cameras[0].camera).fovy[0] == pytest.approx(
        43.6, abs=0.05
    )
    plain = load(SCENE_TOML + '[camera]\ncamera = "above"\n' + PARAMETER)
    assert plain.cameras == (Footage(camera="above", name="above"),)


def test_a_camera_of_its_own_may_be_mounted_on_a_body(scene, load, refuses):
    text = SCENE_TOML + f'[camera]\nbody = "ball"\n{POSE}' + PARAMETER
    model = load(text).load_model()
    its = model.camera("simtune_camera")
    assert model.body(its.bodyid[0]).name == "ball"
    data = mujoco.MjData(model)
    data.joint("x").qpos = 0.5
    mujoco.mj_forward(model, data)
    moved = np.add(data.body("ball").xpos, [0, 0, 4])
    np.testing.assert_allclose(data.camera("simtune_camera").xpos, moved)
    refuses(text.replace('"ball"', '"bal"', 1), 4, "did you mean 'ball'")


def test_another_background_or_calibration_is_another_task(scene, load):
    text = SCENE_TOML + '[camera]\ncamera = "above"\n{}\n' + PARAMETER
    hashes = set()
    for content in (JSON, JSON.replace("-0.2", "-0.1")):
        (scene / "a.json").write_text(content)
        (scene / "wall.png").write_text(content)
        hashes.add(load(text.format('calibration = "a.json"')).content_hash)
        hashes.add(load(text.format('background = "wall.png"')).content_hash)
    assert len(hashes) == 4


OPENCV = """%YAML:1.0
---
image_width: 96
image_height: 64
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 80., 0., 47.5, 0., 80., 31.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.2, 0., 0., 0., 0. ]
"""
ROS = """image_width: 96
image_height: 64
camera_name: top
camera_matrix: {rows: 3, cols: 3, data: [80, 0, 47.5, 0, 80, 31.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.2, 0, 0, 0, 0]}
"""
FISHEYE = OPENCV.replace("image_width", "fisheye_model: 1\nimage_width")
JSON = """{"image_width": 96, "image_height": 64, "dist_coeffs": [[-0.2, 0, 0, 0]],
"camera_matrix": [[80, 0, 47.5], [0, 80, 31.5], [0, 0, 1]]}"""


@pytest.mark.parametrize(("name", "text"), [("a.yml", OPENCV), ("b.yaml", ROS), ("c.json", JSON)])
def test_tuning_file_takes_calibrations_as_others_write_them(scene, load, name, text):
    (scene / name).write_text(text)
    task = load(SCENE_TOML + f'[camera]\ncamera = "above"\ncalibration = "{name}"\n' + PARAMETER)
    assert task.cameras[0].lens == Lens(fx=80, fy=80, **CENTRED, distortion=(-0.2, 0, 0, 0, 0))


@pytest.mark.parametrize(
    ("camera", "line", "message"),
    [
        ('[camera]\ncamera = "abov"', 4, "did you mean 'above'"),
        ('[camera]\ncamera = "above"\nfield_of_view_deg = 40', 5, "leave field_of_view_deg out"),
        (f"[camera]\n{POSE}{INTRINSICS}field_of_view_deg = 40", 7, "the lens says the field"),
        ('[camera]\ncamera = "above"\nbackground = "wall.png"', 5, "no such file beside"),
        ('[camera]\ncamera = "above"\ndistortion = [0, 0, 0, 0, 0]', 5, "goes with intrinsics"),
        ('[camera]\ncamera = "above"\ncalibration = "no.yml"', 5, "cannot read"),
        ('[camera]\ncamera = "above"\ncalibration = "scene.xml"', 5, "calibration"),
        ('[camera]\ncamera = "above"\ncalibration = "fish.yml"', 5, "of a fisheye lens"),
        (f'[camera]\ncamera = "above"\n{INTRINSICS}calibration = "a"', 6, "give calibration, or"),
        ('[camera]\ncamera = "above"\nlens = "wide"', 5, "no key 'lens'"),
        ('[[cameras]]\ncamera = "above"\n[[cameras]]\ncamera = "above"', 5, "the name 'above'"),
        ('[[cameras]]\nname = "above"\n[[cameras]]\nname = "turning"', 5, "two without a key"),
        (
            '[camera]\ncamera = "above"\nlatency_s = 2',
            5,
            "latency_s must be a finite",
        ),
        ('[camera]\ncamera = "above"\ncalibration = "new.yml"', 5, "never calibrated"),
        ('[camera]\ncamera = "above"\ncalibration = "true.yml"', 5, "pixels; got True"),
        (
            '[camera]\ncamera = "above"\n' + INTRINSICS + "distortion = [-3, 0, 0, 0, 0]",
            5,
            "folds the picture's edge",
        ),
    ],
)
def test_tuning_file_says_what_is_wrong_with_a_camera(scene, refuses, camera, line, message):
    (scene / "fish.yml").write_text(FISHEYE)
    (scene / "new.yml").write_text(ROS.replace("80, 0, 47.5, 0, 80, 31.5, 0, 0, 1", "0," * 8 + "0"))
    (scene / "true.yml").write_text(ROS.replace("width: 96", "width: true"))
    refuses(f"{SCENE_TOML}{camera}\n{PARAMETER}", line, message)


def test_an_upright_region_is_not_called_an_upright_picture():
    lens = Lens.pinhole(640, 480, fovy_deg=45)
    for region, seen in ((200, 20, 400, 460), "200×440 is upright"), ((0, 0, 200, 200), "200×200"):
        footage = Footage(lens=replace(lens, region=region), is_square=True)
        with pytest.raises(InputError, match=f"the region of {seen}.* make it wider or less high"):
            footage.aspect((480, 640))
    upright = Lens(48, 64, 80.0, 80.0, 23.5, 31.5)
    with pytest.raises(
        InputError, match=r"what the lens leaves of the picture of 48×64 is upright"
    ):
        Footage(lens=upright, is_square=True).aspect((64, 48))
