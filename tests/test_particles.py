"""Particles follow a known motion, of which they are shown places only."""

import numpy as np
import pytest
from simtune.fit.tracks import Tracks

from simtune.fit.particles import ParticleConfig, Particles
from simtune.fit.physics import Physics
from simtune.fit.windows import log_likelihood
from simtune.randomization import Distribution
from simtune.simulation import StateSpace, random_actions
from simtune.tasks import load_task
from simtune.vision.keypoints import find_keypoints

CARTPOLE = load_task("cartpole")
SPACE = CARTPOLE.parameters
MOVING = np.flatnonzero([not p.is_appearance for p in SPACE])
SPREAD = np.array([0.1, 0.3, 0.5, 1.0])  # of first guesses: cart, pole; their velocities
NOISE_PX = 0.5


@pytest.fixture(scope="module")
def scene():
    """Two episodes of a known world, and how the detector sees them that is wrong one time in five."""
    simulator, rng = CARTPOLE.simulator(image_size=48), np.random.default_rng(0)
    keypoints = find_keypoints(
        simulator, CARTPOLE.camera, Distribution.first(SPACE, SPACE.nominal), 0
    )
    truth = SPACE.clip(SPACE.nominal * np.where(SPACE.is_colour, 0.8, 1.3))
    actions = random_actions(2, 150, simulator.model, rng)
    rollouts = simulator.roll_out(np.repeat(truth[None], 2, 0), actions, rng, keypoints.observe)
    true = rollouts.observed.reshape(2, 151, -1, 2)
    seen = true + NOISE_PX * rng.normal(size=true.shape)
    lost = rng.random(seen.shape[:-1]) < 1 / 5
    seen[lost] = rng.uniform(0, 48, (lost.sum(), 2))
    places = np.stack([seen, rng.uniform(0, 48, seen.shape)], 2)
    probability = np.stack([np.full(lost.shape, 0.8), np.full(lost.shape, 0.1)], 2)
    return simulator, keypoints, truth, rollouts, Tracks(places, probability, rollouts.actions)


def particles(scene, **config) -> Particles:
    simulator, keypoints, _, rollouts, _ = scene
    noise = np.full(len(keypoints), NOISE_PX)
    physics = Physics(simulator, keypoints, rollouts.states[0, 0])
    return Particles(physics, noise, SPREAD, MOVING, ParticleConfig(**{"num": 128, **config}))


def test_states_and_parameters_are_found_from_rough_guesses(scene):
    _, _, truth, rollouts, tracks = scene
    rng, space = np.random.default_rng(1), StateSpace(scene[0].model)
    true = rollouts.states[..., 1:5]
    rough = space.move(true, rng.normal(size=true.shape) * SPREAD)
    unit = SPACE.to_unit(truth)
    unit[MOVING] += [0.1, -0.1]  # half as much again, or two thirds
    followed = particles(scene).follow(tracks, rough, unit, np.full(len(SPACE), 0.1))
    before = np.abs(space.difference(rough, true))[..., :2]
    after = np.abs(space.difference(followed.states, true))[..., :2]
    assert np.median(after) < 0.04 < np.median(before) / 2, (
        "m, rad: the detector's noise of half a pixel"
    )
    assert np.quantile(after, 0.9) < np.quantile(before, 0.9) / 2
    error = followed.unit.mean(0) - SPACE.to_unit(truth)[MOVING]
    assert abs(error[1]) < 0.07, "the gain, which shows at every step"
    assert abs(error[0]) < 0.1, "no farther off than before"


def test_the_same_call_gives_the_same(scene):
    _, _, truth, rollouts, tracks = scene
    short = Tracks(tracks.places[:, :9], tracks.probability[:, :9], tracks.actions[:, :8])
    asked = (short, rollouts.states[:, :9, 1:5], SPACE.to_unit(truth), np.full(len(SPACE), 0.05))
    one, other = (particles(scene, num=16).follow(*asked) for _ in range(2))
    np.testing.assert_array_equal(one.states, other.states)
    assert one.states.shape == (2, 9, 4)
    assert one.unit.shape == (2, len(MOVING))


@pytest.mark.parametrize("steps", [1, 3, 8])
def test_a_path_has_every_step_however_often_particles_are_chosen(scene, steps):
    _, _, truth, rollouts, tracks = scene
    short = Tracks(tracks.places[:, :9], tracks.probability[:, :9], tracks.actions[:, :8])
    followed = particles(scene, num=8, steps=steps).follow(
        short, rollouts.states[:, :9, 1:5], SPACE.to_unit(truth), np.zeros(len(SPACE))
    )
    assert followed.states.shape == (2, 9, 4)


def test_likely_particles_go_on_in_proportion(scene):
    num, rng = 100, np.random.default_rng(0)
    share = np.zeros((2, num))
    share[0, [3, 7]] = 0.75, 0.25
    share[1] = 1 / num  # all count: nothing has to be chosen
    states, units = rng.normal(size=(2, num, 4)), rng.random((2, num, 2))
    weight = rng.normal(size=(2, num))
    _, chosen_units, chosen_weight, parent = particles(scene)._choose(
        states, units, weight, share, np.zeros((2, 4)), rng
    )
    assert np.bincount(parent[0], minlength=num)[[3, 7]].tolist() == [75, 25]
    assert np.abs(chosen_units[0] - units[0, parent[0]]).max() < 0.03
    assert sorted(set(chosen_weight[0])) == [-2.0, 0.0], "what begins anew is less likely"
    np.testing.assert_array_equal(chosen_weight[1], weight[1])
    np.testing.assert_array_equal(parent[1], np.arange(num))


def test_likelihood_of_a_keypoint_by_hand():
    """One keypoint, one frame: at the first place with .6, at the second with .3, else anywhere."""
    residual = np.array([[1.0, 0.0], [0.0, 2.0]])[None, None, :, None]  # (1, 1, 2, 1, 2)
    probability = np.array([0.6, 0.3])[None, None, :, None]
    square = np.array([1.0, 4.0])
    near = [0.6, 0.3] * (np.exp(-square / 2) + 0.05 * np.exp(-square / 32))
    expected = np.log(near.sum() + 0.1 * 0.003)
    np.testing.assert_allclose(log_likelihood(residual, probability), [expected], rtol=1e-9)
