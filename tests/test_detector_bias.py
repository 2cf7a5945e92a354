"""What a detector's errors owe to where things are is told from chance, and taken off."""

import numpy as np
import pytest

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


def test_detections_are_compared_with_where_the_detector_finds_what_is_predicted():
    """Hand arithmetic: 4 px are two scales of a slope of 0.1; beyond three, errors stay."""
    slope = np.array([[0.0, 0.1], [0.0, 0.0]])  # y is found higher, the farther right x is
    bias = DetectorBias(np.array([10.0, 10.0]), np.array([2.0, 1.0]), slope)
    nothing = np.zeros((1, 2))
    noise = DetectorNoise(np.zeros((1, 1)), np.ones((1, 1)), nothing, nothing, bias)
    predicted = np.array([[10.0, 10.0], [14.0, 10.0], [30.0, 10.0]])
    np.testing.assert_allclose(bias(predicted), [[0, 0], [0, 0.2], [0, 0.3]])
    candidates = predicted[:, None, None] + np.zeros((3, 2, 1, 2))
    tracks = KeypointTracks(
        candidates, np.full((3, 2, 1), 0.49), noise.usual_px, (64, 64), bias=noise.bias
    )
    residuals, _ = tracks.linearize(predicted)
    np.testing.assert_allclose(residuals, bias(predicted))
    assert tracks.at(slice(1)).only(np.array([True])).bias is bias
