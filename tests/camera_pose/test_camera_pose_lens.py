"""A lens that nobody declared, or another one, beside the camera's pose."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from test_camera_pose import Filmed, filmed, found_at, options, task  # noqa: F401

from simtune.budget import Budget
from simtune.camera_pose import find
from simtune.camera_pose.bending import BentGeometry, BentRobot
from simtune.camera_pose.edges import EdgeFilm
from simtune.camera_pose.found import Bend, FoundCamera
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.lens_check import lens_warnings, with_lens
from simtune.camera_pose.robot import Outlines, Robot
from simtune.camera_pose.scene import with_any_camera
from simtune.camera_pose.search import CameraSearch
from simtune.camera_pose.sureness import HALF_WIDTH, covariance, half_widths
from simtune.camera_pose.tracking import FINE, NEAR, Agreement, CameraFit, Tracker
from simtune.cameras.distortion import undistort
from simtune.cameras.lens import Lens
from simtune.config import CheckConfig
from simtune.observation import ObservationModel

WIDTH, HEIGHT, FOVY_DEG = 90, 60, 50.0
GOOD = Agreement(0.8, 0.2, 0.9)
LENS = Lens(WIDTH, HEIGHT, 60, 60, 44.5, 29.5, (-0.1, 0, 0, 0, 0))


def pinhole(task, **given) -> CameraGeometry:  # noqa: F811
    searched = CheckConfig(task="", **given)
    tuned = with_any_camera(task, task.cameras[0], searched)
    camera = tuned.cameras[0].camera
    return CameraGeometry.of(tuned.load_model(), camera, tuned.parameters, (HEIGHT, WIDTH))


@pytest.mark.parametrize("lens", [None, replace(LENS, region=(40.0, 5, 85, 45))])
@pytest.mark.parametrize("within_fov_deg", [0.0, 8.0])
def test_a_lens_whose_k1_is_0_bends_nothing(task, lens, within_fov_deg):  # noqa: F811
    flat = pinhole(task, within_fov_deg=within_fov_deg)
    geometry, rng, num = BentGeometry.of(flat, lens), np.random.default_rng(3), len(flat.space)
    unit, points = rng.uniform(0.2, 0.8, num + 1), rng.uniform(-0.4, 0.4, (20, 3))
    straight = np.append(unit[:-1], 0.5)
    expected = flat.project(unit[:-1], points)
    np.testing.assert_allclose(geometry.project(straight, points), expected, atol=1e-9)


def test_a_lens_bends_about_its_axis(task):  # noqa: F811
    """A pixel at a distance r of the axis, in focal lengths, comes to r (1 + k1 r²)."""
    geometry = BentGeometry.of(pinhole(task), None)
    unit = np.append(np.full(6, 0.5), 0.2)
    k1, focal_px = geometry.k1(unit), HEIGHT / 2 / np.tan(np.radians(FOVY_DEG / 2))
    assert k1 == pytest.approx(-0.6 * geometry.largest)
    away = 0.3 * focal_px
    bent = geometry.bend(unit, np.array([[44.5 + away, 29.5], [44.5, 29.5]]))
    np.testing.assert_allclose(bent, [[44.5 + away * (1 + k1 * 0.09), 29.5], [44.5, 29.5]])
    region = replace(LENS, region=(40.0, 5, 85, 45))
    axis = region.turn.inv().apply([0, 0, 1])
    np.testing.assert_allclose(region.bent(axis[:2] / axis[2], -0.3), axis[:2] / axis[2])
    assert np.abs(region.bent(np.zeros(2), -0.3)).max() > 1e-4  # the middle is beside the axis


def test_outlines_are_bent_and_those_outside_of_the_picture_are_gone(task):  # noqa: F811
    geometry = BentGeometry.of(pinhole(task), None)
    pixels = np.array([[20.0, 10], [60, 50], [89, 59]])
    normals = np.array([[1.0, 0], [0.6, 0.8], [0, 1]])

    class Drawn:
        def outlines(self, unit, which, at_most, is_rough):
            assert len(unit) == 6
            return Outlines(np.arange(3), np.zeros((3, 3)), normals, pixels, np.zeros(3))

    unit = np.append(np.full(6, 0.5), 0.9)  # a pincushion
    seen = BentRobot(cast(Robot, Drawn()), geometry).outlines(unit, np.arange(3), 10)
    np.testing.assert_array_equal(seen.frames, [0, 1])
    for pixel, normal, bent in zip(pixels, normals, seen.normals, strict=False):
        along = 1e-4 * np.array([-normal[1], normal[0]])
        tangent = geometry.bend(unit, pixel + along) - geometry.bend(unit, pixel)
        assert abs(tangent @ bent) < 1e-4 * np.linalg.norm(tangent)
        assert np.linalg.norm(bent) == pytest.approx(1)
        assert bent @ normal > 0.9


def through(frames: np.ndarray, fovy_deg: float, k1: float) -> np.ndarray:
    """(M, H, W, 3) pictures of a pinhole, as a lens of the same focal length shows them."""
    height, width = frames.shape[1:3]
    focal_px = height / 2 / np.tan(np.radians(fovy_deg / 2))
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    row, column = np.mgrid[:height, :width]
    seen = (np.stack([column, row], -1) - middle) / focal_px
    at = undistort((k1, 0, 0, 0, 0), seen) * focal_px + middle
    at = at.clip(0, [width - 1.001, height - 1.001])
    first = at.astype(int)
    share = (at - first)[None, :, :, :, None]
    (x, y), (right, down) = np.moveaxis(first, -1, 0), np.moveaxis(share, 3, 0)
    above = frames[:, y, x] * (1 - right) + frames[:, y, x + 1] * right
    below = frames[:, y + 1, x] * (1 - right) + frames[:, y + 1, x + 1] * right
    return np.rint(above * (1 - down) + below * down).astype(np.uint8)


def judged(filmed: Filmed, k1: float, lens: Lens | None = None) -> tuple[FoundCamera, FoundCamera]:  # noqa: F811
    """The camera found without and with a lens, in half of a film through one."""
    frames = filmed.frames[::2]
    frames = through(frames, FOVY_DEG, k1) if k1 else frames
    film = EdgeFilm(frames, np.median(frames, 0))
    tracker = Tracker(film, filmed.robot, filmed.geometry, filmed.every[::2])
    fit = tracker.fit(filmed.truth, (*NEAR[3:5], *FINE[:6]))
    assert fit
    found = FoundCamera(fit, tracker.agreement(fit.unit), fit.unit[None])
    return found, with_lens(found, tracker, filmed.robot, filmed.geometry, lens)


@pytest.mark.thorough
@pytest.mark.parametrize("k1", [-0.25, 0.25])
def test_a_film_through_a_lens_is_noticed(filmed, k1):  # noqa: F811
    alone, both = judged(filmed, k1)
    assert both.is_bent
    assert both.bend
    assert both.bend.k1 == pytest.approx(k1, abs=0.08)
    off = [np.abs(found.fit.unit - filmed.truth).max() for found in (alone, both)]
    assert off[1] < 0.6 * off[0]
    held = [np.abs(its.fit.unit - filmed.truth) <= half_widths(its) for its in (alone, both)]
    assert held[1].all()
    assert not held[0].all()
    (said,) = lens_warnings(both, None)
    assert f"k1 of about {both.bend.k1:.2f} (" in said


@pytest.mark.thorough
@pytest.mark.parametrize("lens", [None, Lens(240, 240, 257, 257, 119.5, 119.5)])
def test_a_film_without_a_lens_is_told_as_such(filmed, lens):  # noqa: F811
    alone, both = judged(filmed, 0.0, lens)
    assert not both.is_bent
    assert both.bend
    assert abs(both.bend.k1) < 2 * both.bend.k1_std
    np.testing.assert_array_equal(both.fit.unit, alone.fit.unit)
    assert (half_widths(both) >= half_widths(alone)).all()
    assert lens_warnings(both, lens) == []
    # A calibration is known better, so less is left to a lens that differs.
    assert both.bend.k1_usual == (0.02 if lens else 0.1)
    share = both.bend.k1_usual**2 / (both.bend.k1_usual**2 + both.bend.k1_std**2)
    expected = share * (both.bend.fit.unit[:-1] - both.fit.unit)
    np.testing.assert_allclose(both.ends[-1] - both.fit.unit, expected, atol=1e-12)


def test_where_nothing_is_seen_no_lens_is_tried(filmed):  # noqa: F811
    found = FoundCamera(
        filmed.tracker.fit(filmed.truth, FINE[-1:]), Agreement(0.2, 0.2, 0.9), np.eye(6)
    )
    its = with_lens(found, filmed.tracker, filmed.robot, filmed.geometry, None)
    assert its is found


def bend_of(alike: float, k1_usual: float) -> tuple[FoundCamera, Bend]:
    """One unknown of the camera and k1, whose slopes are alike by this share."""
    rng = np.random.default_rng(0)
    ours, other = rng.choice([-1.0, 1.0], (2, 960))
    slopes = 100 * np.stack([ours, alike * ours + np.sqrt(1 - alike**2) * other], 1)
    fit = CameraFit(
        np.array([0.5, 0.5]), np.arange(8).repeat(120), np.ones(960), ours * other, slopes
    )
    std = float(np.sqrt(covariance(fit)[-1, -1]))
    bend = Bend(fit, 0.0, std, 1.0, k1_usual)
    return FoundCamera(bend.camera, GOOD, bend.camera.unit[None]), bend


def test_intervals_allow_for_a_lens_that_cannot_be_told():
    """Two unknowns alike by c: not knowing the second divides the first's variance by 1 − c²."""
    found, bend = bend_of(0.98, k1_usual=1e3)
    wide = half_widths(found._replace(bend=bend))
    np.testing.assert_allclose(wide, HALF_WIDTH * np.sqrt(covariance(bend.fit)[:1, 0]), rtol=1e-4)
    assert wide > 3 * half_widths(found)
    known = half_widths(found._replace(bend=bend._replace(k1_usual=1e-6)))
    np.testing.assert_allclose(known, half_widths(found), rtol=0.05)
    # A lens that explains the film clearly better is whatever it is.
    bent = found._replace(bend=bend._replace(k1_usual=1e-6), is_bent=True)
    np.testing.assert_allclose(half_widths(bent), wide, rtol=1e-4)


def test_a_lens_is_named_beside_what_is_declared():
    found, bend = bend_of(0.5, k1_usual=0.1)
    bent = found._replace(bend=bend._replace(k1=-0.34, k1_std=0.02), is_bent=True)
    (said,) = lens_warnings(bent, None)
    assert "k1 of about -0.34 (-0.38 to -0.30) explains them better than none" in said
    assert "`intrinsics` and `distortion`" in said
    # A region alone declares no lens.
    (of_region,) = lens_warnings(bent, replace(LENS.pinhole(90, 60, 50), region=(0, 0, 45, 30)))
    assert of_region == said
    (beside,) = lens_warnings(bent, LENS)
    assert (
        "k1 of about -0.44 (-0.48 to -0.40) explains them better than the declared -0.1" in beside
    )
    assert "with its signs?" in beside
    assert lens_warnings(found._replace(bend=bend), LENS) == []


def test_the_answer_has_the_warning(filmed, monkeypatch):  # noqa: F811
    alone = found_at(filmed.truth)
    slopes, off_px = 100 * np.tile(np.eye(7), (160, 1)), np.tile([1.0, -1.0], 560)
    unit, frames = np.append(filmed.truth, 0.5), np.arange(8).repeat(140)
    fit = CameraFit(unit, frames, np.ones(1120), off_px, slopes)
    bent = alone._replace(bend=Bend(fit, -0.2, 0.02, 1.0, 0.1), is_bent=True)
    monkeypatch.setattr(find, "_known", lambda *_: (filmed.frames, filmed.states))
    monkeypatch.setattr(CameraSearch, "run", lambda *_: bent)
    seen = ObservationModel.of_reality(filmed.task.sensors, filmed.task.cameras)
    result = find.find_pose(filmed.task, seen, [], Budget(1.0))
    assert result["warnings"] == lens_warnings(bent, None)
    monkeypatch.setattr(CameraSearch, "run", lambda *_: alone)
    assert find.find_pose(filmed.task, seen, [], Budget(1.0))["warnings"] == []
