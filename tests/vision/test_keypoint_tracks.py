"""Keypoints as evidence: likelihoods and residuals by hand."""

import numpy as np
import pytest
from keypoint_evidence import tracks_at

from simtune.vision.detections import Detections
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.keypoint_tracks import KeypointTracks


def one_keypoint(first, second, probability=(0.6, 0.3), noise_px: float = 1.0) -> KeypointTracks:
    """In one frame, at either of two places."""
    candidates = np.array([first, second], float)[None, :, None]
    return KeypointTracks(
        candidates, np.array(probability)[None, :, None], np.array([noise_px]), (64, 64)
    )


def by_hand(square: np.ndarray, probability: np.ndarray) -> float:
    """Σ p [N(r) + .05 N(r/4)], and anywhere else with a small density."""
    near = probability * (np.exp(-square / 2) + 0.05 * np.exp(-square / 32))
    return float(np.log(near.sum() + (1 - probability.sum()) * 0.003))


def test_likelihood_of_one_keypoint_is_the_mixture_by_hand():
    tracks = one_keypoint((10, 20), (11, 22))
    expected = by_hand(np.array([1.0, 4.0]), np.array([0.6, 0.3]))
    # One pixel left of the first place, two above the second
    np.testing.assert_allclose(tracks.log_likelihood(np.array([[11.0, 20.0]])), expected, rtol=1e-9)


def test_blur_and_noise_divide_distances():
    at = np.array([[16.0, 20.0]])  # 6 px from both
    for noise_px, blur in ((3.0, 1.0), (1.0, 3.0), (1.5, 2.0)):
        tracks = one_keypoint((10, 20), (22, 20), noise_px=noise_px)
        expected = by_hand(np.array([4.0, 4.0]), np.array([0.6, 0.3]))
        assert tracks.log_likelihood(at, blur) == pytest.approx(expected)


def test_likelihood_adds_over_keypoints_and_frames_and_broadcasts():
    rng = np.random.default_rng(0)
    candidates = rng.uniform(0, 20, (3, 5, 2, 4, 2))
    probability = rng.dirichlet([1, 1, 1], (3, 5, 4))[..., :2].swapaxes(-1, -2)
    noise = np.array([0.5, 1.0, 2.0, 3.0])
    tracks = KeypointTracks(candidates, probability, noise, (64, 64))
    predicted = rng.uniform(0, 20, (7, 3, 5, 8))
    found = tracks.log_likelihood(predicted)
    assert found.shape == (7, 3)
    for particle, episode in ((0, 0), (6, 2)):
        total = 0.0
        for frame in range(5):
            for keypoint in range(4):
                point = predicted[particle, episode, frame, 2 * keypoint : 2 * keypoint + 2]
                away = (point - candidates[episode, frame, :, keypoint]) / noise[keypoint]
                square = np.square(away).sum(-1)
                total += by_hand(square, probability[episode, frame, :, keypoint])
        assert found[particle, episode] == pytest.approx(total)


def test_weighted_residuals_are_the_gradient_of_the_likelihood():
    tracks = one_keypoint((10, 20), (50, 50), probability=(0.9, 0.0), noise_px=2.0)
    for at in ([10.5, 21.0], [13.0, 16.0], [19.0, 20.0]):
        predicted, delta = np.array([at]), 1e-5
        residual, weight = tracks.linearize(predicted)
        np.testing.assert_allclose(residual[0], (predicted[0] - [10, 20]) / 2)
        gradient = [
            -(tracks.log_likelihood(predicted + s) - tracks.log_likelihood(predicted - s))
            / (2 * delta)
            for s in delta * np.eye(2)[:, None]
        ]
        np.testing.assert_allclose(weight[0] * residual[0] / 2, gradient, rtol=1e-4)
    assert weight.max() < 0.7, "what is far away counts less"


def test_residuals_are_to_the_candidate_that_explains_best():
    tracks = one_keypoint((10, 20), (30, 20))
    residual, _ = tracks.linearize(np.array([[28.0, 20.0]]))
    np.testing.assert_allclose(residual, [[-2, 0]])
    residual, _ = tracks.linearize(np.array([[12.0, 20.0]]))
    np.testing.assert_allclose(residual, [[2, 0]])


def test_typical_distance_is_the_median_of_what_is_sure_in_pixels():
    points = np.zeros((1, 5, 4))
    tracks = tracks_at(points, noise_px=0.5)
    predicted = points + np.array([3.0, 4.0, 0.0, 1.0])  # 5 px and 1 px away
    predicted[0, :3, :2] = [0, 1]
    assert tracks.typical_distance(predicted) == pytest.approx(1)
    unsure = tracks_at(points, noise_px=0.5, probability=0.5)
    assert np.isnan(unsure.typical_distance(predicted))


def test_features_are_about_one_in_size():
    tracks = one_keypoint((0, 63), (32, 32))
    np.testing.assert_allclose(tracks.features, [[-4, 3.875, 0, 0, 0.6, 0.3]])
    assert tracks.num_observations == 1


def test_tracks_of_detections_are_never_entirely_sure():
    rng = np.random.default_rng(0)
    candidates = rng.uniform(0, 64, (2, 7, 2, 3, 2))
    probability = np.zeros((2, 7, 2, 3))
    probability[:, :, 0] = 1.0
    episodes = [
        Detections(its[:, 0], its, known, np.zeros(its.shape), np.zeros((7, 0)))
        for its, known in zip(candidates, probability, strict=True)
    ]
    std, offset = np.array([[1.0], [2.0], [3.0]]), rng.normal(size=(3, 2))
    noise = DetectorNoise(np.zeros((3, 1)), std, offset, np.zeros((3, 2)))
    tracks = KeypointTracks.of_detections(episodes, (64, 64), noise)
    np.testing.assert_allclose(tracks.candidates + offset, candidates)
    np.testing.assert_allclose(tracks.probability, 0.99 * probability)
    np.testing.assert_array_equal(tracks.scale, [1, 1, 2, 2, 3, 3])
    assert np.isfinite(tracks.log_likelihood(np.full((2, 7, 6), 1e6))).all()
    part = tracks.at((slice(None), slice(3)))
    np.testing.assert_array_equal(part.candidates, tracks.candidates[:, :3])
