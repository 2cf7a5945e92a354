"""What a detector's errors owe to where things are is told from chance, and taken off."""

import numpy as np
import pytest

from simtune.vision.detections import Detections
from simtune.vision.detector_bias import DetectorBias
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.keypoint_tracks import KeypointTracks

WORLDS, PICTURES, KEYPOINTS = 24, 60, 2
STD_PX = 0.3


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def places(rng) -> np.ndarray:
    """(E, K, L, 2) px; the second keypoint's y never changes."""
    truth = rng.normal(32, 8, (WORLDS, PICTURES, KEYPOINTS, 2))
    truth[..., 1, 1] = 40
    return truth


def test_errors_that_follow_places_are_found_whatever_worlds_have_in_common(rng):
    truth = places(rng)
    errors = STD_PX * rng.normal(size=truth.shape) + rng.normal(size=(WORLDS, 1, KEYPOINTS, 2))
    usual = 0.02 * (truth[..., 0, 0] - 32) - 0.01 * (truth[..., 1, 0] - 32)
    errors[..., 0, 1] += usual
    errors[rng.random(errors.shape) < 0.2] = np.nan
    errors[rng.random(errors.shape) < 0.05] = 20  # found elsewhere
    found = DetectorBias.measured(truth, errors)(truth.reshape(WORLDS, PICTURES, -1))
    expected = np.zeros_like(found)
    expected[..., 1] = usual
    clipped = np.abs(truth.reshape(found.shape) - 32).max(-1) > 3 * 8
    np.testing.assert_allclose(found[~clipped], expected[~clipped], atol=0.08)


def test_chance_is_no_bias(rng):
    truth = places(rng)
    errors = STD_PX * rng.normal(size=truth.shape)
    bias = DetectorBias.measured(truth, errors)(truth.reshape(WORLDS, PICTURES, -1))
    x = np.concatenate([np.ones((truth[..., 0, 0].size, 1)), truth.reshape(-1, 4)[:, :3]], 1)
    unshrunk = x @ np.linalg.lstsq(x, errors.reshape(-1, 4), rcond=None)[0]
    assert np.square(bias).mean() < 0.4 * np.square(unshrunk - unshrunk.mean(0)).mean()


@pytest.mark.parametrize("pictures", [1, 2])
def test_too_few_pictures_show_no_bias(pictures):
    truth = np.full((1, pictures, 2, 2), 20.0)
    bias = DetectorBias.measured(truth, np.full(truth.shape, 0.5))
    np.testing.assert_array_equal(bias(truth.reshape(1, pictures, 4) + 5), 0)


def test_what_was_measured_is_taken_off_what_is_detected(rng):
    """Also from the noise, and from what a world's errors have in common."""
    truth = places(rng)
    usual = np.zeros_like(truth)
    usual[..., 0, 0] = 0.5 + 0.05 * (truth[..., 0, 0] - 32)  # px
    found = truth + usual + STD_PX * rng.normal(size=truth.shape)
    candidates = np.repeat(found[:, :, None], 2, 2)
    known, exact = np.full(candidates.shape[:-1], 0.49), np.zeros(candidates.shape)
    nothing = np.zeros((PICTURES, 0))
    episodes = [
        Detections(its[:, 0], its, sure, spread, nothing)
        for its, sure, spread in zip(candidates, known, exact, strict=True)
    ]
    noise = DetectorNoise.measured(episodes, truth)
    np.testing.assert_allclose(noise.usual_px, STD_PX + 0.05, rtol=0.1)
    np.testing.assert_allclose(noise.common_px, 0, atol=0.05)
    tracks = KeypointTracks.of_detections(episodes, (64, 64), noise)
    residuals, _ = tracks.linearize(truth.reshape(WORLDS, PICTURES, -1))
    away = residuals[..., 0] * noise.usual_px[0]
    assert abs(away.mean()) < 0.05
    assert abs(np.corrcoef(away.ravel(), truth[..., 0, 0].ravel())[0, 1]) < 0.1


def test_detections_are_compared_with_where_the_detector_finds_what_is_predicted():
    """Hand arithmetic: 4 px are two scales of a slope of 0.1; beyond three, errors stay."""
    slope = np.array([[0.0, 0.1], [0.0, 0.0]])  # y is found larger, the farther right x is
    bias = DetectorBias(np.array([10.0, 10.0]), np.array([2.0, 1.0]), slope)
    predicted = np.array([[10.0, 10.0], [14.0, 10.0], [30.0, 10.0]])
    np.testing.assert_allclose(bias(predicted), [[0, 0], [0, 0.2], [0, 0.3]])
    candidates = predicted[:, None, None] + np.zeros((3, 2, 1, 2))
    tracks = KeypointTracks(candidates, np.full((3, 2, 1), 0.49), np.ones(1), (64, 64), bias=bias)
    residuals, _ = tracks.linearize(predicted)
    np.testing.assert_allclose(residuals, bias(predicted))
    assert tracks.at(slice(1)).only(np.array([True])).bias is bias
