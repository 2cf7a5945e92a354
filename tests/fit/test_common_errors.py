"""What all detections are off alike is not taken for a parameter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from keypoint_evidence import tracks_at

from simtune.fit import Observed, Physics
from simtune.fit.motion.common_errors import directions
from simtune.fit.motion.shooting import Shooting, ShootingFit
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.observation import AllEvidence
from simtune.randomization import Distribution
from simtune.tasks import load_task
from simtune.vision.keypoints import find_keypoints

TASK = load_task(str(Path(__file__).parents[2] / "examples" / "phone_pendulum" / "tune.toml"))
LENGTH, STEPS, NOISE_PX, LOW_PX = 0, 48, 0.3, 2.0
SPREAD = np.array([0.02, 0.2])  # of first guesses at angle and velocity
TRUTH = TASK.parameters.nominal * np.where(np.arange(len(TASK.parameters)) == LENGTH, 1.3, 1.0)


def fit(common_px: float) -> tuple[ShootingFit, float]:
    """Of a bob that is detected LOW_PX too low in all pictures; and how far off its length is."""
    simulator, space, rng = TASK.simulator(image_size=64), TASK.parameters, np.random.default_rng(0)
    keypoints = find_keypoints(simulator, Distribution.first(space, TRUTH), 0)
    rollouts = simulator.roll_out(
        np.repeat(TRUTH[None], 4, 0), np.zeros((4, STEPS, 0)), rng, keypoints.observe
    )
    points = rollouts.observed + NOISE_PX * rng.normal(size=rollouts.observed.shape)
    points[..., 1::2] += LOW_PX
    evidence = AllEvidence((replace(tracks_at(points, NOISE_PX), common_px=common_px),))
    states = rollouts.states[..., 1:3] + SPREAD * rng.normal(size=rollouts.states[..., 1:3].shape)
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    shooting = Shooting(physics, SPREAD, np.array([LENGTH]), ShootingConfig())
    found = shooting.fit(Observed(evidence, rollouts.actions), states, TRUTH)
    return found, float(found.unit[0] - space.to_unit(TRUTH)[LENGTH])


def test_a_bob_that_is_seen_too_low_hangs_from_no_longer_rope():
    (alone, wrong), (found, off) = fit(0.0), fit(1.0)
    assert abs(off) < abs(wrong) / 10
    assert abs(off) < 3 * np.sqrt(found.covariance[0, 0])
    assert found.covariance[0, 0] < alone.covariance[0, 0] / 9
    assert alone.distances[0] > 2 * found.distances[0]


def test_unknowns_are_of_those_predictions_that_are_off_alike():
    points = np.zeros((1, 2, 4))
    its = replace(tracks_at(points, 1.0), common_px=np.array([[0.5, 0.0], [0.0, 2.0]]))
    found = directions(AllEvidence((its, tracks_at(points, 1.0))))
    expected = np.zeros((2, 8))
    expected[0, 0], expected[1, 3] = 5.0, 20.0  # of unknowns that are usually 0.1
    np.testing.assert_allclose(found, expected)
