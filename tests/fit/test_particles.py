"""Particles follow a known motion, of which they are shown keypoints only."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from simtune.fit import Observed, Physics
from simtune.fit.motion.particles import Particles
from simtune.observation import AllEvidence
from simtune.randomization import Distribution
from simtune.simulation import StateSpace, random_actions
from simtune.tasks import load_task
from simtune.vision.keypoint_tracks import KeypointTracks
from simtune.vision.keypoints import find_keypoints

CARTPOLE = load_task("cartpole")
SPACE = CARTPOLE.parameters
MOVING = np.flatnonzero([not p.is_appearance for p in SPACE])
SPREAD = np.array([0.1, 0.3, 0.5, 1.0])  # of first guesses: cart, pole; their velocities
NOISE_PX = 0.5


@pytest.fixture(scope="module")
def scene():
    """Two episodes of a known world, seen by a detector that is wrong one time in five."""
    simulator, rng = CARTPOLE.simulator(image_size=48), np.random.default_rng(0)
    keypoints = find_keypoints(simulator, Distribution.first(SPACE, SPACE.nominal), 0)
    truth = SPACE.clip(SPACE.nominal * np.where(SPACE.is_colour, 0.8, 1.3))
    actions = random_actions(2, 150, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(np.repeat(truth[None], 2, 0), actions, rng, keypoints.observe)
    true = rollouts.observed.reshape(2, 151, -1, 2)
    seen = true + NOISE_PX * rng.normal(size=true.shape)
    lost = rng.random(seen.shape[:-1]) < 1 / 5
    seen[lost] = rng.uniform(0, 48, (lost.sum(), 2))
    candidates = np.stack([seen, rng.uniform(0, 48, seen.shape)], 2)
    probability = np.stack([np.full(lost.shape, 0.8), np.full(lost.shape, 0.1)], 2)
    tracks = KeypointTracks(candidates, probability, np.full(len(keypoints), NOISE_PX), (48, 48))
    return simulator, keypoints, truth, rollouts, Observed(AllEvidence((tracks,)), rollouts.actions)


def particles(scene, num: int = 128) -> Particles:
    simulator, keypoints, _, rollouts, _ = scene
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    return Particles(physics, SPREAD, MOVING, num)


def first_steps(observed: Observed, steps: int) -> Observed:
    evidence = observed.evidence.at((slice(None), slice(steps + 1)))
    return Observed(evidence, observed.actions[:, :steps])


@pytest.mark.thorough
def test_particles_find_states_and_gain_from_rough_guesses(scene):
    _, _, truth, rollouts, observed = scene
    rng, space = np.random.default_rng(1), StateSpace(scene[0].model)
    true = rollouts.states[..., 1:5]
    rough = space.move(true, rng.normal(size=true.shape) * SPREAD)
    unit = SPACE.to_unit(truth)
    unit[MOVING] += [0.1, -0.1]  # half as much again, or two thirds
    followed = particles(scene).follow(observed, rough, unit, np.full(len(SPACE), 0.1))
    before = np.abs(space.difference(rough, true))[..., :2]
    after = np.abs(space.difference(followed.states, true))[..., :2]
    assert np.median(after) < 0.04 < np.median(before) / 2, (
        "m, rad: the detector's noise of half a pixel"
    )
    assert np.quantile(after, 0.9) < np.quantile(before, 0.9) / 2
    error = followed.unit.mean(0) - SPACE.to_unit(truth)[MOVING]
    assert abs(error[1]) < 0.07, "the gain, which shows at every step"
    assert abs(error[0]) < 0.1, "no farther off than before"


def test_particles_are_repeatable(scene):
    _, _, truth, rollouts, observed = scene
    guesses = (rollouts.states[:, :9, 1:5], SPACE.to_unit(truth), np.full(len(SPACE), 0.05))
    short = first_steps(observed, 8)
    one, other = (particles(scene, num=16).follow(short, *guesses) for _ in range(2))
    np.testing.assert_array_equal(one.states, other.states)
    assert one.states.shape == (2, 9, 4)
    assert one.unit.shape == (2, len(MOVING))


@dataclass(frozen=True)
class Readings:
    """`Evidence` of the first unit coordinate itself, with normal noise."""

    measured: np.ndarray  # (..., K)
    std: float

    name, unit, num_observations = "parameter", "1", 1

    @property
    def scale(self) -> np.ndarray:
        return np.array([self.std])

    def at(self, index) -> "Readings":
        return replace(self, measured=self.measured[index])

    def log_likelihood(self, predicted: np.ndarray, blur: float = 1.0) -> np.ndarray:
        return -0.5 * np.square((predicted[..., 0] - self.measured) / self.std).sum(-1)


class StillPhysics:
    """Nothing moves, and the first parameter's unit coordinate is what a sensor measures."""

    def __init__(self, model):
        self.space = StateSpace(model)
        self.simulator = SimpleNamespace(model=model)

    def play(self, states, units, actions, actuator_states=None):
        frames = actions.shape[1] + 1
        predicted = np.repeat(units[:, :1, None], frames, 1)
        return np.repeat(states[:, None], frames, 1), predicted

    def replay_actuators(self, actions, states, unit):
        return np.zeros((len(actions), actions.shape[1] + 1, 1))

    def states(self, full_states):
        return full_states


def follow_still(scene, measured: np.ndarray, std: float, prior_std: float, num: int):
    physics = StillPhysics(scene[0].model)
    followed = Particles(physics, SPREAD, np.arange(1), num)
    num_episodes, frames = measured.shape
    observed = Observed(
        AllEvidence((Readings(measured, std),)), np.zeros((num_episodes, frames - 1, 1))
    )
    states = np.zeros((num_episodes, frames, 4))
    return followed.follow(observed, states, np.array([0.5]), np.array([prior_std]))


def test_particles_parameter_is_that_of_a_tempered_kalman_filter(scene):
    """So they go on in proportion to their likelihood, whatever was chosen in between."""
    rng, std, prior_std, frames = np.random.default_rng(3), 0.1, 0.1, 41
    measured = 0.65 + std * rng.normal(size=(3, frames))
    followed = follow_still(scene, measured, std, prior_std, num=4000)
    expected = []
    for episode in measured:
        mean, precision, means = 0.5, prior_std**-2, []
        for t, value in enumerate(episode):
            gained = 0.3 / std**2  # neighbouring frames go together: each counts for 0.3
            mean = (precision * mean + gained * value) / (precision + gained)
            precision += gained
            if t:
                means.append(mean)
        expected.append(np.mean(means[len(means) // 2 :]))
    claimed_std = precision**-0.5
    np.testing.assert_allclose(followed.unit[:, 0], expected, atol=0.25 * claimed_std)
    assert np.abs(np.array(expected) - 0.5).min() > 3 * claimed_std, "the prior is far away"


def test_equally_likely_particles_all_go_on(scene):
    followed = follow_still(scene, np.full((1, 30), 0.5), std=1e6, prior_std=0.1, num=50)
    assert np.ptp(followed.states, axis=1).max() == 0, "no particle was ever replaced"
    assert abs(followed.unit[0, 0] - 0.5) < 0.05
