"""What is observed: pictures, and beside them a sensor of joints."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from keypoint_evidence import tracks_at
from search_context import CARTPOLE, SIZE, STEPS, context_of

from simtune.budget import Budget
from simtune.fit import FitConfig, Observed, Physics, PointEstimate, ReplayFit, StateEstimator
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.pictures.response import Photometry
from simtune.networks.training import TrainingClock
from simtune.observation import AllEvidence, JointReadings, JointSensor, ObservationModel
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.simulation import Simulator, random_actions
from simtune.trajectory import Trajectory
from simtune.tuning.posterior import PosteriorSearch
from simtune.vision.keypoints import find_keypoints


@dataclass(frozen=True)
class NormalEvidence:
    """`Evidence` of readings with normal noise of one size."""

    readings: np.ndarray  # (..., K, D)
    std: float
    name: str = "encoder"
    unit: str = "rad"

    @property
    def scale(self) -> np.ndarray:
        return np.full(self.readings.shape[-1], self.std)

    @property
    def common_std(self) -> np.ndarray:
        return np.zeros(self.readings.shape[-1])

    @property
    def num_observations(self) -> int:
        return self.readings.shape[-1]

    @property
    def features(self) -> np.ndarray:
        return self.readings

    def at(self, index) -> "NormalEvidence":
        return replace(self, readings=self.readings[index])

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        residuals = (predicted - self.readings) / (blur * self.std)
        return -0.5 * np.square(residuals).sum((-1, -2))

    def linearize(self, predicted: np.ndarray, blur: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        residuals = (predicted - self.readings) / (blur * self.std)
        return residuals, np.ones_like(residuals)

    def typical_distance(self, predicted: np.ndarray) -> float:
        return float(np.median(np.abs(predicted - self.readings)))


STD, JOINTS = 0.003, ("slider", "hinge_1")
POSITIONS: dict[str, Any] = {
    "name": "encoder",
    "columns": JOINTS,
    "joints": JOINTS,
    "places": np.arange(2),
    "factor": np.ones(2),
    "shift": np.zeros(2),
    "noise": STD,
    "offset": np.zeros(2),
}
ENCODER = JointSensor(**POSITIONS)
SPACE = ParameterSpace([p for p in CARTPOLE.parameters if not p.is_appearance])
TRUTH = SPACE.clip(SPACE.nominal * [1.6, 0.7])  # a pole's mass, a motor's gain
BOTH = ObservationModel.of_simulator(sensors=(ENCODER,))
NOTHING = np.zeros(2)
CAMERA_ONLY = ObservationModel.of_simulator()


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return replace(CARTPOLE, parameters=SPACE).simulator(image_size=SIZE)


@pytest.fixture(scope="module")
def keypoints(simulator):
    first = Distribution.first(SPACE, SPACE.nominal)
    return find_keypoints(simulator, first, 0)


# --- evidence of several sensors ----------------------------------------------------------


def test_all_evidence_adds_likelihoods_and_concatenates_residuals_by_hand():
    points = np.array([[[10.0, 20.0], [12.0, 20.0]]])  # one keypoint, in two frames
    tracks = tracks_at(points, noise_px=2.0)
    angles = NormalEvidence(np.array([[[0.5], [0.7]]]), std=0.1)
    both = AllEvidence((tracks, angles))
    np.testing.assert_array_equal(both.scale, [2.0, 2.0, 0.1])
    assert both.num_observations == 2
    assert both.features.shape == (1, 2, 6 + 1)
    predicted = np.array([[[11.0, 20.0, 0.6], [12.0, 20.0, 0.4]]])
    of_tracks = np.log(
        [0.98 * (np.exp(-square / 2) + 0.05 * np.exp(-square / 32)) + 0.02 * 0.003
         for square in (0.25, 0.0)]
    ).sum()  # fmt: skip
    of_angles = -0.5 * (1.0**2 + 3.0**2)
    np.testing.assert_allclose(both.log_likelihood(predicted), [of_tracks + of_angles])
    residuals, weights = both.linearize(predicted)
    np.testing.assert_allclose(residuals, [[[0.5, 0, 1], [0, 0, -3]]], atol=1e-9)
    assert weights.shape == residuals.shape
    np.testing.assert_array_equal(weights[..., 2], 1)
    assert both.distances(predicted) == pytest.approx([0.5, 0.2])
    blurred, _ = both.linearize(predicted, blur=2.0)
    np.testing.assert_allclose(blurred, residuals / 2)


def test_all_evidence_at_an_index_takes_it_of_every_sensor():
    rng = np.random.default_rng(0)
    points, readings = rng.uniform(0, 60, (3, 9, 4)), rng.normal(size=(3, 9, 2))
    both = AllEvidence((tracks_at(points, 1.0), NormalEvidence(readings, 0.1)))
    windows = both.at((np.array([[2], [0]]), np.array([[1, 2, 3], [5, 6, 7]])))
    tracks, angles = windows.parts
    np.testing.assert_array_equal(tracks.candidates[1, 0, 0].ravel(), points[0, 5])
    np.testing.assert_array_equal(angles.readings, [readings[2, 1:4], readings[0, 5:8]])
    predicted = rng.normal(size=(7, 2, 3, 6))
    assert windows.log_likelihood(predicted).shape == (7, 2)


# --- what a simulator would measure -------------------------------------------------------


def test_keypoints_and_sensors_are_predicted_side_by_side(simulator, keypoints):
    observe, rng = BOTH.observe_beside(keypoints.observe), np.random.default_rng(0)
    actions = random_actions(2, 5, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(np.tile(TRUTH, (2, 1)), actions, rng, observe)
    count = 2 * len(keypoints)
    assert rollouts.observed.shape == (2, 6, count + 2)
    np.testing.assert_allclose(rollouts.observed[..., count:], rollouts.states[..., 1:3], atol=1e-9)


def test_recorded_trajectories_have_every_sensors_noisy_readings(simulator):
    rng = np.random.default_rng(0)
    actions = random_actions(8, 60, simulator.action_mapping, rng)
    see = BOTH.observe_beside()
    rollouts = simulator.roll_out(np.tile(TRUTH, (8, 1)), actions, rng, see)
    recorded = BOTH.record(simulator, rollouts, rng)
    readings = np.stack([trajectory.readings["encoder"] for trajectory in recorded])
    errors = readings - rollouts.states[..., 1:3]
    assert errors.std() == pytest.approx(STD, rel=0.1)
    assert abs(errors.mean()) < 0.2 * STD
    np.testing.assert_array_equal(recorded[3].frames, simulator.film(rollouts)[3])
    assert recorded[3].first(10).readings["encoder"].shape == (11, 2)
    assert CAMERA_ONLY.readings(rollouts.observed[..., :0], rng) == {}


# --- a fit --------------------------------------------------------------------------------


TRUTHS = SPACE.clip(SPACE.nominal * [[1.8, 0.6], [0.6, 1.6]])  # mass, gain


def scaled_as(observed: Observed, other: Observed) -> Observed:
    """With readings on the scale of another's, from which the state estimator has learnt."""
    like = {part.name: part for part in other.evidence.parts if isinstance(part, JointReadings)}
    evidence = observed.evidence.with_each(JointReadings, lambda its: its.scaled_as(like[its.name]))
    return replace(observed, evidence=evidence)


def fit_errors(simulator, keypoints, observation: ObservationModel) -> np.ndarray:
    """(2, 2) unit coordinates by which a fit from the nominal parameters is off, of each truth.

    The detector is sure of no keypoint at all.
    """
    rng, steps, count = np.random.default_rng(1), 48, 2 * len(keypoints)
    see = BOTH.observe_beside(keypoints.observe)

    def play(worlds: np.ndarray):
        actions = random_actions(len(worlds), steps, simulator.action_mapping, rng)
        return simulator.roll_out(worlds, actions, rng, see)

    def observed(rollouts) -> Observed:
        tracks = tracks_at(rollouts.observed[..., :count], 1.0, SIZE, probability=0.0)
        tracks = replace(tracks, candidates=np.full_like(tracks.candidates, SIZE / 2))
        readings = BOTH.readings(rollouts.observed[..., count:], rng)
        evidence, frames = observation.evidence(tracks, readings), simulator.film(rollouts)
        return Observed(evidence, rollouts.actions, list(frames))

    first = Distribution.first(SPACE, SPACE.nominal)
    to_learn = play(first.sample(40, rng))
    see_its_own = observation.observe_beside(keypoints.observe)
    physics = Physics(simulator, see_its_own, to_learn.states[0, 0])
    learnt_from = observed(to_learn)
    estimator = StateEstimator.train(
        learnt_from,
        physics.states(to_learn.states),
        physics.space,
        simulator.action_scale,
        0,
        TrainingClock(100),
    )
    config = FitConfig(
        num_particles=48,
        shooting=ShootingConfig(stages=(Stage(4, 3, 3.0), Stage(12, 6)), longer=()),
    )
    nothing_known = Photometry(None, np.full(len(SPACE), np.nan))
    replay_fit = ReplayFit(
        physics, estimator, config, discrepancy_std=NOTHING, photometry=nothing_known
    )
    start = np.full(2, 0.15)
    errors = []
    for truth in TRUTHS:
        played = play(np.tile(truth, (2, 1)))
        real = scaled_as(observed(played), learnt_from)
        fit = replay_fit.fit(real, PointEstimate(SPACE.nominal, start))
        assert fit.sensors == tuple((part.name, part.unit) for part in real.evidence.parts)
        assert len(fit.misfit.motion) == len(fit.sensors)
        begun = physics.states(np.stack([fit.starts, played.states[:, 0]]))[..., :2]
        if observation is BOTH:
            np.testing.assert_allclose(begun[0], begun[1], atol=4 * STD)
        errors.append(SPACE.to_unit(fit.parameters) - SPACE.to_unit(truth))
    return np.abs(errors)


@pytest.mark.slow
def test_fit_recovers_mass_and_gain_from_a_sensor_where_keypoints_tell_nothing(
    simulator, keypoints
):
    begun = np.abs(SPACE.to_unit(SPACE.nominal) - SPACE.to_unit(TRUTHS))
    with_sensor = fit_errors(simulator, keypoints, BOTH)
    without = fit_errors(simulator, keypoints, CAMERA_ONLY)
    assert with_sensor.max() < 0.02
    assert without.mean() > begun.mean() / 2
    assert without.mean() > 8 * with_sensor.mean()


# --- a whole search -----------------------------------------------------------------------


class CountingSensor(JointSensor):
    """Remembers the shapes of what it was asked to measure, and of what it made evidence of."""

    def __init__(self):
        super().__init__(**POSITIONS)
        object.__setattr__(self, "measured", [])
        object.__setattr__(self, "explained", [])

    def measure(self, observed: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        self.measured.append(observed.shape)
        return super().measure(observed, rng)

    def evidence(self, readings: np.ndarray) -> JointReadings:
        self.explained.append(readings.shape)
        return super().evidence(readings)


@pytest.mark.thorough
def test_search_round_uses_readings_of_the_real_world_and_of_its_refits(tiny):
    simulator = CARTPOLE.simulator(image_size=SIZE)
    space, rng, sensor = simulator.space, np.random.default_rng(2), CountingSensor()
    observation = ObservationModel.of_simulator(sensors=(sensor,))
    actions = random_actions(3, STEPS, simulator.action_mapping, rng)
    worlds, see = np.tile(space.nominal, (3, 1)), observation.observe_beside()
    real = observation.record(simulator, simulator.roll_out(worlds, actions, rng, see), rng)
    sensor.measured.clear()
    context = replace(context_of(simulator), observation=observation)
    config = replace(tiny, num_rounds=1, planned_refits=2, most_refits=2)
    search = PosteriorSearch(context, config)
    estimate, _, metrics = search.run_round(real, Budget())
    assert np.isfinite(estimate.mean).all()
    assert np.isfinite(list(metrics.values())).all()
    assert {len(ranks) for ranks in estimate.ranks.values()} <= {1, 2}
    # Held-out worlds, those near the first guess and near the fit, and two refits of three episodes
    refits = [(3, STEPS + 1, 2)] * 2
    assert sensor.measured == [(6, 8, 2)] * 3 + refits
    assert sensor.explained == [(6, 8, 2), (3, STEPS + 1, 2), *refits]


@pytest.mark.thorough
def test_search_needs_the_readings_of_every_sensor(tiny):
    simulator = CARTPOLE.simulator(image_size=SIZE)
    context = replace(context_of(simulator), observation=BOTH)
    actions = np.zeros((STEPS, 1), np.float32)
    blind = Trajectory(np.zeros((STEPS + 1, SIZE, SIZE, 3), np.uint8), actions, simulator.step_s)
    with pytest.raises(KeyError, match="encoder"):
        PosteriorSearch(context, replace(tiny, num_rounds=1)).run_round([blind], Budget())
