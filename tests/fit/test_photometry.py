"""The cameras' responses and known colours: known truths recovered, sums by hand."""

from dataclasses import replace

import numpy as np
import pytest

from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.fit.pictures.picture_fit import PictureFit, Pictures, exposed, fit_pictures
from simtune.fit.pictures.response import CameraResponse, step_by_known_colours
from simtune.fit.pictures.scene import SHOWN, PictureScene, PixelSlopes
from simtune.parameters import ParameterSpace
from simtune.recordings import decode, write_video
from simtune.sweep.contents import check_options
from simtune.tasks import load_any_task, load_task, with_known_colours
from simtune.vision.image_noise import ImageNoise
from simtune.vision.smoothing import smoothed, with_smooth_chroma

SCENE = """
<mujoco>
  <visual><headlight ambient=".3 .3 .3" diffuse=".6 .6 .6" specular="0 0 0"/></visual>
  <worldbody>
    <camera name="front" pos="0 -2 .4" xyaxes="1 0 0 0 .2 1" fovy="45"/>
    <geom name="card" type="box" size=".25 .05 .25" pos="-.4 0 .4" euler="20 0 30"/>
    <body name="ball" pos=".3 0 .6"><joint name="slide" type="slide" axis="1 0 0"/>
      <geom name="ball" size=".2"/></body>
    <geom name="post" type="capsule" size=".1" fromto=".2 0 0 .7 0 .1"/>
  </worldbody>
  <actuator><motor name="push" joint="slide"/></actuator>
</mujoco>
"""
TUNING = """
model = "scene.xml"
control_timestep_s = 0.02
[[parameters]]
name = "mass"
kind = "mass"
objects = "ball"
"""
COLOURS = {"card": (0.5, 0.5, 0.5), "ball": (0.7, 0.3, 0.2), "post": (0.2, 0.4, 0.6)}
TRUTH = np.concatenate(list(COLOURS.values()))
CARD = np.arange(9) < 3
CAMERA = CameraResponse(np.array([*np.log([0.9, 0.8, 0.65]), np.log(1.05), 0.005]))


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    (folder / "scene.xml").write_text(SCENE)
    text = TUNING
    for name, rgb in COLOURS.items():
        text += f'[[parameters]]\nname = "{name}"\nkind = "colour"\nobjects = "{name}"\n'
        text += f"nominal = {list(rgb)}\nknown = {str(name == 'card').lower()}\n"
    (folder / "tune.toml").write_text(text)
    return load_any_task(str(folder / "tune.toml"))


@pytest.fixture(scope="module")
def simulator(task):
    return task.simulator(image_size=40)


@pytest.fixture(scope="module")
def pictures(task, simulator):
    """By CAMERA, before they become a video."""
    states = simulator.roll_out(task.parameters.nominal[None], np.zeros((1, 8, 1)), rng(0)).states
    rows = states.reshape(-1, states.shape[-1])
    drawn = simulator.render(rows, np.repeat(task.parameters.nominal[None], len(rows), 0))
    frames = np.rint(255 * CAMERA(drawn.astype(np.float32) / 255)).astype(np.uint8)
    return Pictures(frames=frames, full_states=rows, camera_noise=ImageNoise())


@pytest.fixture(scope="module")
def fit(task, simulator, pictures):
    """`fit(is_known)`: from colours that are far off."""
    shown = np.arange(1, 10)

    def fit(is_known: np.ndarray, **changes) -> PictureFit:
        start = task.parameters.nominal.copy()
        start[shown] = np.where(is_known, TRUTH, 0.45)
        return fit_pictures(simulator, replace(pictures, **changes), start, shown, is_known)

    return fit


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_known_colour_tells_gain_and_white_balance_and_so_the_other_colours(fit):
    found = fit(CARD)
    np.testing.assert_allclose(found.unit, TRUTH, rtol=0.04)
    np.testing.assert_array_equal(found.unit[CARD], TRUTH[CARD])
    (response,) = found.responses
    np.testing.assert_allclose(response.gain, CAMERA.gain, rtol=0.04)
    assert response.gamma == pytest.approx(CAMERA.gamma, abs=0.05)
    std = np.sqrt(np.diag(found.covariance))
    assert (std[CARD] == 0).all()
    assert (np.abs(found.unit - TRUTH)[~CARD] < 2.5 * std[~CARD]).all()
    assert (std[~CARD] < 0.08 * TRUTH[~CARD]).all()


def test_exposures_that_drift_are_no_errors_of_colours(fit, pictures, task, simulator):
    drift = np.exp(0.2 * np.sin(np.linspace(0, 4, len(pictures.frames))))
    drift /= np.exp(np.log(drift).mean())
    worlds = np.repeat(task.parameters.nominal[None], len(drift), 0)
    drawn = simulator.render(pictures.full_states, worlds).astype(np.float32) / 255
    frames = np.rint(255 * CAMERA(drawn, drift)).astype(np.uint8)
    found = fit(CARD, frames=frames)
    np.testing.assert_allclose(found.unit, TRUTH, rtol=0.03)
    np.testing.assert_allclose(found.responses[0].gain, CAMERA.gain, rtol=0.04)
    np.testing.assert_allclose(found.log_exposure[:, 0], np.log(drift), atol=0.02)


def test_exposures_by_hand():
    """Of two pictures, each of a pixel a channel, of which the last one shows no parameter."""
    shown = np.array([[[1.0, 1, 0], [1, 1, 0]]])
    response = np.zeros((5, 2, 3))
    response[0, :, 0], response[1, :, 1], response[2, :, 2] = 0.5, 0.5, 0.5
    none = np.zeros((0, 2, 3))
    weight, residual = np.full((2, 3), 1e6), np.array([[-0.1, -0.1, 9], [0.02, 0.02, 9]])
    after = exposed(np.zeros((2, 1)), PixelSlopes(shown, none, response, none), weight, residual)
    # By themselves 0.2 brighter and 0.04 darker; their mean is the gain's.
    np.testing.assert_allclose(after[:, 0], [0.12, -0.12], atol=1e-3)


def test_gamma_is_told_where_a_known_colour_has_many_levels():
    levels = np.tile(np.linspace(0.02, 1, 50, dtype=np.float32)[:, None], 3)[None, None]
    truth = CameraResponse(np.array([-0.1, 0.05, 0.0, np.log(1.2), 0.0]))
    at = np.zeros(5)
    for _ in range(8):
        response = CameraResponse(at)
        drawn, residual = (
            part.reshape(1, -1) for part in (response(levels), response(levels) - truth(levels))
        )
        slopes = response.derive(levels).reshape(5, 1, -1)
        told = step_by_known_colours(slopes, np.ones_like(drawn), residual, drawn, ImageNoise(), at)
        at = at + told.step
    np.testing.assert_allclose(at, truth.unknown, atol=0.06)
    assert np.exp(at[3]) == pytest.approx(1.2, abs=0.06)


def test_without_a_known_colour_ratios_are_told_and_brightness_is_not(fit):
    found = fit(np.zeros(9, bool))
    assert found.responses[0].unknown == pytest.approx(np.zeros(5))
    assert (found.unit < 0.95 * TRUTH).all()  # as dark as they are seen
    widths, same = [], [(0, 3), (0, 6), (3, 6), (1, 4), (1, 7), (4, 7), (2, 5), (2, 8), (5, 8)]
    for i, j in same:
        ratio, true = found.unit[i] / found.unit[j], TRUTH[i] / TRUTH[j]
        assert ratio == pytest.approx(true, rel=0.1)  # gamma is not known either
        relative = np.zeros(9)
        relative[[i, j]] = 1 / found.unit[i], -1 / found.unit[j]
        of_ratio = np.sqrt(relative @ found.covariance @ relative)
        of_one = np.sqrt(found.covariance[i, i]) / found.unit[i]
        widths.append((of_one, of_ratio))
    one, ratio = np.median(widths, 0)
    assert one > 0.05
    assert ratio < 0.6 * one


def test_a_videos_blur_of_chroma_is_found_and_colours_with_it(fit, pictures, tmp_path):
    sharp = fit(CARD)
    np.testing.assert_allclose(sharp.blur, 0, atol=0.1)
    write_video(tmp_path / "a.mp4", pictures.frames, fps=1, keyframe_interval=1)
    filmed = np.stack([frame for _, frame in decode(tmp_path / "a.mp4")])
    found = fit(CARD, frames=filmed)
    assert 0.4 < found.blur[0, 1] < 2
    np.testing.assert_allclose(found.unit, TRUTH, atol=0.02)


def test_a_lens_that_is_soft_is_found_and_makes_thin_things_no_paler(fit, pictures):
    sharp = pictures.frames.astype(np.float32)
    soft = np.rint(sharp + 0.7 * (smoothed(sharp) - sharp)).astype(np.uint8)
    found = fit(CARD, frames=soft)
    assert found.blur[0, 0] == pytest.approx(0.7, abs=0.1)
    assert found.blur[0, 1] < 0.2
    np.testing.assert_allclose(found.unit, TRUTH, atol=0.02)


def test_derivatives_by_the_blur_are_those_of_what_is_seen(simulator, pictures):
    parameters, shown = simulator.space.nominal, np.arange(1, 10)
    scene = PictureScene(simulator, pictures.full_states, shown, None, True, parameters)
    scene.blur, unit = np.array([0.3, 0.5]), simulator.space.to_unit(parameters)
    drawn = scene.draw(unit)
    slopes = scene.derive(unit, drawn)
    told = (np.abs(slopes.shown) > SHOWN).any(0)
    for i, change in enumerate(0.01 * np.eye(2)):
        scene.blur = np.array([0.3, 0.5]) + change
        by_hand = (scene.draw(unit) - drawn) / 0.01
        np.testing.assert_allclose(slopes.blur[i], by_hand * told, atol=1e-3)
        assert np.abs(slopes.blur[i]).max() > 0.01


def test_a_camera_sharper_than_the_simulators_pictures_leaves_colours_as_they_are(fit, pictures):
    drawn = pictures.frames.astype(np.float32)
    sharp = np.rint((drawn + 0.3 * (drawn - smoothed(drawn))).clip(0, 255)).astype(np.uint8)
    found = fit(CARD, frames=sharp)
    np.testing.assert_array_equal(found.blur[0, 0], 0)
    np.testing.assert_allclose(found.unit, TRUTH, atol=0.03)


def test_pictures_that_are_the_simulators_own_have_no_response(fit):
    seen = fit(CARD, camera_noise=None)
    assert seen.responses == []
    assert np.abs(seen.unit / TRUTH - 1).max() > 0.15  # it is the colours that are darker, then


def test_a_response_by_hand_and_its_derivatives():
    response = CameraResponse(np.array([np.log(2), 0, np.log(0.5), np.log(2), 0.1]))
    drawn = np.array([[0.5, 0.5, 0.5], [0.9, 0.0, 1.0]], np.float32)
    seen = [[0.1 + 2 * 0.25, 0.1 + 0.25, 0.1 + 0.125], [1.0, 0.1, 0.6]]
    np.testing.assert_allclose(response(drawn), seen, rtol=1e-6)
    np.testing.assert_allclose(
        list(response.to_json().values())[1:], [2.0, 0.1]
    )  # gamma and offset
    slopes = response.derive(drawn)
    for i, delta in enumerate(1e-3 * np.eye(5)):
        up, down = (CameraResponse(response.unknown + s * delta)(drawn) for s in (1, -1))
        np.testing.assert_allclose(slopes[i], (up - down) / 2e-3, atol=2e-3)


def test_colours_of_thin_things_survive_a_video_once_chroma_is_smoothed(tmp_path):
    ground, colour, stripe = 90.0, np.array([200.0, 60.0, 60.0]), slice(15, 18)
    drawn = np.full((1, 32, 32, 3), ground, np.uint8)
    drawn[:, :, stripe] = colour
    write_video(tmp_path / "a.mp4", drawn, fps=1)
    filmed = np.stack([frame for _, frame in decode(tmp_path / "a.mp4")]).astype(np.float32)

    def explained(see) -> np.ndarray:
        """(3,) the stripe's colour by least squares, where all else is known."""
        by_channel = np.zeros((3, *drawn.shape), np.float32)
        for channel in range(3):
            by_channel[channel, :, :, stripe, channel] = 1
        slopes = see(by_channel).reshape(3, -1)
        return ground + np.linalg.lstsq(slopes.T, see(filmed - ground).ravel(), rcond=None)[0]

    raw, smooth = (np.abs(explained(see) - colour) for see in (np.array, with_smooth_chroma))
    assert (raw > 4).all()  # greyer
    assert (smooth < 0.5 * raw).all()


def test_luma_stays_where_chroma_is_smoothed():
    before = rng(0).random((6, 8, 3)).astype(np.float32)
    luma = np.array([0.299, 0.587, 0.114])
    np.testing.assert_allclose(with_smooth_chroma(before) @ luma, before @ luma, atol=1e-6)
    dot = np.zeros((5, 5, 1))
    dot[2, 2] = 16
    np.testing.assert_array_equal(smoothed(dot)[1:4, 1:4, 0], [[1, 2, 1], [2, 4, 2], [1, 2, 1]])


def test_what_is_known_is_what_a_tuning_file_or_an_option_says(task):
    assert task.known_colours == {"card_r": 0.5, "card_g": 0.5, "card_b": 0.5}
    both = with_known_colours(task, "ball=.7,.3,0; post")
    assert both.known_colours == task.known_colours | {
        **{"ball_r": 0.7, "ball_g": 0.3, "ball_b": 0.0},
        **{"post_r": 0.2, "post_g": 0.4, "post_b": 0.6},
    }
    assert with_known_colours(task, None).known_colours == task.known_colours


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ("grund", "no colour 'grund' in the parameters; did you mean 'ground'"),
        ("pole_mass", "no colour 'pole_mass'"),
        ("ground=1,1", "expected NAME, or NAME=R,G,B from 0 to 1 each"),
        ("ground=1,1,nan", "expected NAME, or NAME=R,G,B"),
        ("ground=1,1,red", "expected NAME, or NAME=R,G,B"),
        ("ground=1,1,2", "three numbers from 0 to 1"),
    ],
)
def test_what_is_no_known_colour(asked, message):
    with pytest.raises(InputError, match=message):
        with_known_colours(load_task("cartpole"), asked)


def test_all_that_there_is_to_tune_cannot_be_known(task):
    colours = ("card_r", "card_g", "card_b", "post_r", "post_g", "post_b")
    small = replace(task, parameters=ParameterSpace([task.parameters[name] for name in colours]))
    with pytest.raises(InputError, match="--known-colour post: nothing to tune: all parameters"):
        with_known_colours(small, "post")
    assert len(with_known_colours(small, None).known_colours) == 3


@pytest.mark.parametrize("search", ["paper", "regression"])
def test_a_colour_that_a_tuning_file_knows_goes_with_the_posterior_search(tmp_path, task, search):
    check_options(TuneConfig(task="card", out=tmp_path), task)
    said = f"known = true, .* of card, goes with --search posterior, got {search}"
    with pytest.raises(InputError, match=said):
        check_options(TuneConfig(task="card", out=tmp_path, search=search), task)
