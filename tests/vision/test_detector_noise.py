"""The detector's noise is told by how far its heatmaps spread."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from simtune.vision.detections import Detections
from simtune.vision.detector import DetectorConfig, KeypointDetector, splat
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.keypoint_tracks import KeypointTracks

STD = np.array([0.3, 1.0, 2.5])


def detected(candidates, spread) -> list[Detections]:
    known = np.full(candidates.shape[:-1], 0.48)
    return [
        Detections(places[:, 0], places, sure, its, np.zeros((len(places), 0)))
        for places, sure, its in zip(candidates, known, spread, strict=True)
    ]


def test_it_is_the_robust_std_of_the_better_candidate():
    rng = np.random.default_rng(0)
    truth = rng.uniform(10, 50, (20, 30, 3, 2))
    right = truth + STD[:, None] * rng.normal(size=truth.shape)
    wrong = truth + rng.choice([-15.0, 15.0], truth.shape)
    swapped = rng.random(truth.shape[:-1])[..., None] < 0.3
    candidates = np.stack([np.where(swapped, wrong, right), np.where(swapped, right, wrong)], 2)
    noise = DetectorNoise.measured(detected(candidates, np.zeros(candidates.shape)), truth)
    np.testing.assert_allclose(noise.usual_px, STD + 0.05, rtol=0.08)


def test_it_grows_with_the_spread_where_errors_do():
    rng = np.random.default_rng(0)
    truth = rng.uniform(10, 50, (40, 60, 2, 2))
    spread = rng.uniform(0, 2, (40, 60, 1, 2, 2)).repeat(2, 2)
    std = np.stack([0.2 + spread[..., 0, 0, :], np.full((*spread.shape[:2], 2), 0.5)], -2)
    right = truth + std * rng.normal(size=truth.shape)
    candidates = np.stack([right, truth + 30], 2)
    noise = DetectorNoise.measured(detected(candidates, spread), truth)
    asked = np.array([[0.3, 1.0], [0.3, 1.0]]) + np.zeros((1, 2, 2))
    expected = np.array([[0.55, 1.25], [0.55, 0.55]])
    np.testing.assert_allclose(noise(asked)[0], expected, rtol=0.12)


def test_a_few_pictures_tell_one_noise():
    truth = np.full((1, 30, 1, 2), 20.0)
    candidates = np.repeat(truth[:, :, None] + 1.0, 2, 2)
    noise = DetectorNoise.measured(detected(candidates, np.zeros(candidates.shape)), truth)
    assert noise.std_px == pytest.approx(1.4826 + 0.05)


def test_what_errors_of_a_world_have_in_common_is_told_from_chance():
    rng = np.random.default_rng(0)
    truth, common = rng.uniform(10, 50, (300, 40, 2, 2)), np.array([[0.5, 0.0], [0.2, 1.0]])
    usual = np.array([[0.0, 2.0], [-0.5, 0.0]])
    right = truth + usual + common * rng.normal(size=(300, 1, 2, 2))
    right += 0.4 * rng.normal(size=truth.shape)
    unseen = rng.random(truth.shape[:-1]) < 0.2
    candidates = np.stack([np.where(unseen[..., None], right + 20, right)] * 2, 2)
    found = detected(candidates, np.zeros(candidates.shape))
    found = [
        its._replace(probability=np.where(far[:, None], 0.1, its.probability))
        for its, far in zip(found, unseen, strict=True)
    ]
    noise = DetectorNoise.measured(found, truth)
    np.testing.assert_allclose(noise.common_px, common, atol=0.06, rtol=0.1)
    np.testing.assert_allclose(noise.offset_px, usual, atol=0.12)
    tracks = KeypointTracks.of_detections(found[:1], (64, 64), noise)
    np.testing.assert_allclose(tracks.common_std, noise.common_px.ravel())


def test_a_keypoint_counts_as_its_own_noise_says():
    """Hand arithmetic: twice as noisy as usual is a quarter of the information."""
    candidates = np.full((1, 1, 2, 2, 2), 10.0)
    probability = np.zeros((1, 1, 2, 2))
    probability[..., 0, :] = 0.99
    information = np.ones((1, 1, 2, 2, 2))
    information[..., 1, 1] = 0.25  # of the second keypoint's y
    tracks = KeypointTracks(candidates, probability, np.ones(2), (64, 64), information)
    away = np.array([[[10.0, 10.0, 10.0, 10.5]]])
    residuals, weights = tracks.linearize(away)
    np.testing.assert_allclose(residuals[0, 0], [0, 0, 0, 0.5])
    assert weights[0, 0, 3] / weights[0, 0, 2] == pytest.approx(0.25)
    sharp = KeypointTracks(candidates, probability, np.ones(2), (64, 64))
    exact = np.full((1, 1, 4), 10.0)
    lost = [
        float((t.log_likelihood(exact) - t.log_likelihood(away)).sum()) for t in (tracks, sharp)
    ]
    assert lost[0] / lost[1] == pytest.approx(0.25, rel=0.02)


def test_a_sharp_heatmap_has_no_spread_wherever_between_cells_it_is():
    detector = KeypointDetector(1, 0, (32, 32), DetectorConfig())
    places = torch.tensor([[[8.5, 8.5]], [[9.1, 12.0]], [[20.0, 11.3]]])
    sharp = splat(places, detector.cells).clamp(min=1e-12).log()
    found, _, spread = detector.candidates(sharp)
    torch.testing.assert_close(found[:, 0], places, atol=1e-3, rtol=0)
    assert spread[:, 0].max() < 0.02
    wide = (splat(places - 2, detector.cells) + splat(places + 2, detector.cells)) / 2
    _, _, spread = detector.candidates(wide.clamp(min=1e-12).log())
    torch.testing.assert_close(spread[:, 0], torch.full((3, 1, 2), 2.0), atol=0.3, rtol=0)


@pytest.mark.parametrize(
    ("moved_px", "common_px", "is_off"),
    [
        (0.09, 0.0, False),  # of .05, less than which no error is known
        (0.11, 0.0, True),
        (0.19, 0.087, False),  # √(.087² + .05²) = .1
        (0.21, 0.087, True),
    ],
)
def test_an_error_is_another_one_beyond_two_of_its_standard_deviations(moved_px, common_px, is_off):
    """Of one coordinate of two keypoints, in either direction."""
    curve, none = np.ones((2, 1)), np.full((2, 2), common_px)
    old = DetectorNoise(curve, curve, np.full((2, 2), 0.3), none)
    for side in (-1, 1):
        moved = old.offset_px.copy()
        moved[1, 0] += side * moved_px
        assert replace(old, offset_px=moved).is_off(old) is is_off
