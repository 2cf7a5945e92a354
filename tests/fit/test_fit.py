"""The fit of physics and pictures: known truths recovered."""

import math
import time
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from simtune.fit import FitConfig, FitWork, Observed, Physics
from simtune.fit.motion.shooting import Shooting, ShootingFit
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.pictures.picture_fit import Pictures, fit_pictures
from simtune.fit.pictures.pixel_noise import rounding_std
from simtune.fit.pictures.window_pictures import well_fitted
from simtune.fit.sizing import fit_to_budget
from simtune.observation import AllEvidence
from simtune.randomization import Distribution
from simtune.simulation import StateSpace, random_actions
from simtune.tasks import load_task
from simtune.vision.keypoint_tracks import KeypointTracks
from simtune.vision.keypoints import find_keypoints

CARTPOLE = load_task("cartpole")
SPACE = CARTPOLE.parameters
MOVING = np.flatnonzero([not p.is_appearance for p in SPACE])
APPEARANCE = np.flatnonzero([p.is_appearance for p in SPACE])

ALL_JOINTS = """
<mujoco><worldbody>
  <body><freejoint/><geom size=".1"/>
    <body pos="0 0 1"><joint type="ball"/><geom size=".1"/>
      <body pos="0 0 1"><joint type="hinge" axis="0 1 0"/><geom size=".1"/>
        <body pos="0 0 1"><joint type="hinge" axis="1 0 0" range="-1 1" limited="true"/>
          <joint type="slide"/><geom size=".1"/></body></body></body></body>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def simulator():
    return CARTPOLE.simulator(image_size=48)


@pytest.fixture(scope="module")
def played(simulator):
    """Three episodes of a known world, and its keypoints."""
    rng = np.random.default_rng(0)
    keypoints = find_keypoints(simulator, Distribution.first(SPACE, SPACE.nominal), 0)
    truth = SPACE.clip(SPACE.nominal * np.where(SPACE.is_colour, 0.8, 1.3))
    actions = random_actions(3, 96, simulator.action_mapping, rng)
    rollouts = simulator.roll_out(np.repeat(truth[None], 3, 0), actions, rng, keypoints.observe)
    return keypoints, truth, rollouts


def observed_of(rollouts, noise_px: float, mixed_up: float, rng) -> Observed:
    """By a detector that is sometimes sure of another keypoint's place."""
    true = rollouts.observed.reshape(*rollouts.observed.shape[:2], -1, 2)
    seen = true + noise_px * rng.normal(size=true.shape)
    other = np.roll(seen, 1, axis=2)
    swapped = rng.random(seen.shape[:-1]) < mixed_up
    first = np.where(swapped[..., None], other, seen)
    second = np.where(swapped[..., None], seen, other)
    probability = np.full(first.shape[:-1], 1 - mixed_up)
    both = np.stack([probability, mixed_up + 0 * probability], 2) * 0.99
    noise = np.full(first.shape[2], noise_px)
    tracks = KeypointTracks(np.stack([first, second], 2), both, noise, (48, 48))
    return Observed(AllEvidence((tracks,)), rollouts.actions.astype(float))


def shooting(simulator, keypoints, rollouts, fitted=MOVING) -> Shooting:
    config = ShootingConfig(stages=(Stage(4, 4, 4.0, states_only=True), Stage(12, 8)))
    prior_std = np.array([0.1, 0.1, 0.5, 0.5])
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    return Shooting(physics, prior_std, fitted, config)


def rough_states(rollouts, rng) -> np.ndarray:
    states = rollouts.states[..., 1:5]
    return states + rng.normal(size=states.shape) * [0.05, 0.05, 0.3, 0.3]


def some_states(seed: int):
    """20 states of a model that has joints of all kinds."""
    model = mujoco.MjModel.from_xml_string(ALL_JOINTS)
    space, rng = StateSpace(model), np.random.default_rng(seed)
    states = np.zeros((20, model.nq + model.nv))
    states[:, : model.nq] = model.qpos0
    states = space.move(states, rng.normal(size=(20, space.num_tangent)))
    return model, space, states, rng


def test_state_move_and_difference_are_inverse():
    model, space, states, rng = some_states(0)
    tangent = 0.3 * rng.normal(size=(20, space.num_tangent))
    moved = space.move(states, tangent)
    np.testing.assert_allclose(space.difference(moved, states), tangent, atol=1e-9)
    position = states[0, : model.nq].copy()  # as MuJoCo itself integrates
    mujoco.mj_integratePos(model, position, tangent[0, : model.nv], 1.0)
    np.testing.assert_allclose(moved[0, : model.nq], position, atol=1e-9)


def test_state_features_give_the_state_back():
    _, space, states, _ = some_states(1)
    again = space.from_features(space.features(states))
    np.testing.assert_allclose(space.difference(again, states), 0, atol=1e-6)
    turned = states.copy()
    turned[:, 11] += 2 * np.pi  # the unlimited hinge
    np.testing.assert_allclose(space.features(turned), space.features(states), atol=1e-9)


@pytest.mark.thorough
def test_shooting_recovers_mass_and_gain_from_noisy_keypoints(simulator, played):
    keypoints, truth, rollouts = played
    rng = np.random.default_rng(2)
    observed = observed_of(rollouts, 0.2, 0.1, rng)
    start = truth.copy()
    start[MOVING] *= [0.6, 1.5]
    found = shooting(simulator, keypoints, rollouts).fit(
        observed, rough_states(rollouts, rng), start
    )
    unit = SPACE.to_unit(truth)
    unit[MOVING] = found.unit
    np.testing.assert_allclose(SPACE.from_unit(unit)[MOVING], truth[MOVING], rtol=0.05)
    assert found.distances[0] < 0.4
    deviation = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.unit - SPACE.to_unit(truth)[MOVING]) < 4 * deviation + 0.002).all()


@pytest.mark.thorough
def test_shooting_fits_worse_with_a_wrong_pole_length(simulator, played):
    keypoints, truth, rollouts = played
    rng = np.random.default_rng(3)
    observed = observed_of(rollouts, 0.2, 0.0, rng)
    states = rough_states(rollouts, rng)
    longer = CARTPOLE.load_spec()
    for geom in longer.geoms:
        if geom.name == "pole_1":
            geom.fromto = [*geom.fromto[:5], 1.3 * geom.fromto[5]]
    none = MOVING[:0]
    right = shooting(simulator, keypoints, rollouts, none).fit(observed, states, truth)
    other = replace(CARTPOLE, load_spec=lambda: longer).simulator(image_size=48)
    wrong = shooting(other, keypoints, rollouts, none).fit(observed, states, truth)
    assert wrong.distances[0] > 1.5 * right.distances[0]


@pytest.mark.thorough
def test_picture_fit_recovers_colours(simulator, played):
    _, truth, rollouts = played
    rows = rollouts.states[:, ::12].reshape(-1, rollouts.states.shape[-1])
    frames = simulator.render(rows, np.repeat(truth[None], len(rows), 0))
    start = truth.copy()
    start[APPEARANCE] = np.clip(truth[APPEARANCE] + [0.2, -0.2, 0.2, -0.2, 0.2, -0.2], 0, 1)
    found = fit_pictures(simulator, Pictures(frames=frames, full_states=rows), start, APPEARANCE)
    np.testing.assert_allclose(found.unit, truth[APPEARANCE], atol=0.005)


def test_rounding_leaves_less_open_where_pixels_have_many_levels():
    slope, one = np.full((2, 8), 0.5), 1 / 255 / np.sqrt(12)  # of a level
    flat = np.full((2, 8), 100 / 255)
    assert rounding_std(slope, flat) == pytest.approx(one / 0.5)
    four = flat + np.arange(8) // 2 / 255
    assert rounding_std(slope, four) == pytest.approx(one / 0.5 / 2)  # each tells as much
    unseen = np.where(np.arange(8) < 4, slope, 0.001)  # half of it does not show the parameter
    assert rounding_std(unseen, four) == pytest.approx(one / 0.5 / np.sqrt(2))
    assert rounding_std(0 * slope, four) == pytest.approx(one / 0.05)


def test_picture_fit_recovers_colours_though_most_states_are_wrong(simulator, played):
    _, truth, rollouts = played
    rows = rollouts.states[:, ::8].reshape(-1, rollouts.states.shape[-1])
    frames = simulator.render(rows, np.repeat(truth[None], len(rows), 0))
    lost = np.random.default_rng(0).random(len(rows)) < 0.6
    moved = rows.copy()
    moved[lost, 1] += 0.3  # m, of the cart
    start = SPACE.to_unit(truth)
    start[APPEARANCE] -= 0.12
    fit = fit_pictures(
        simulator, Pictures(frames=frames, full_states=moved), SPACE.from_unit(start), APPEARANCE
    )
    np.testing.assert_allclose(fit.unit, SPACE.to_unit(truth)[APPEARANCE], atol=0.01)


def test_pictures_are_those_in_which_things_are_where_the_fit_has_them(simulator, played):
    keypoints, truth, rollouts = played
    rng = np.random.default_rng(0)
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    episode, step = np.repeat([0, 1, 2], 8), np.tile(np.arange(0, 96, 12), 3)
    full_states = rollouts.states[episode[:, None], step[:, None] + np.arange(13)]
    is_off = rng.random(full_states.shape[:2]) < 0.7
    full_states[is_off, 2] += 0.5  # rad, of the pole
    nothing = np.zeros(0)
    motion = ShootingFit(
        nothing, np.zeros((0, 0)), full_states, episode, step, nothing, (0.0,), nothing
    )
    window, at = well_fitted(physics, motion, observed_of(rollouts, 0.3, 0.0, rng), truth, 40)
    assert 39 <= len(window) <= 41
    assert not is_off[window, at].any()
    assert ((at >= 3) & (at <= 9)).all()
    assert set(episode[window]) == {0, 1, 2}


@pytest.mark.parametrize(("light", "blue", "away"), [(0.9, 0.7, -0.15), (0.6, 0.9, -0.3)])
def test_picture_fit_finds_colours_though_much_of_them_is_overexposed(light, blue, away):
    """What is white in both pictures would hold a colour where it only just is."""
    task = load_task("rope_peg")
    simulator, space = task.simulator(image_size=48), task.parameters
    colours = {"lighting": light, "box_r": 0.29, "box_g": 0.37, "box_b": blue}
    truth, actions = space.from_dict(colours), np.random.default_rng(0).uniform(-1, 1, (1, 12, 3))
    rows = simulator.roll_out(truth[None], actions, np.random.default_rng(0)).states[0]
    frames = simulator.render(rows, np.repeat(truth[None], len(rows), 0))
    assert (frames == 255).mean() > 0.02
    start, shown = space.to_unit(truth), np.array([p.is_appearance for p in space])
    start[shown] += away
    pictures = Pictures(frames=frames, full_states=rows)
    fit = fit_pictures(simulator, pictures, space.from_unit(start), np.flatnonzero(shown))
    np.testing.assert_allclose(fit.unit, space.to_unit(truth)[shown], atol=0.01)


def test_picture_fit_finds_the_colour_of_a_few_pixels_from_afar():
    """While such an object has another colour, its pixels look noisy and seem to tell little."""
    task = load_task("rope_peg")
    simulator, space = task.simulator(image_size=28), task.parameters
    colours, rng = {"lighting": 0.3} | {f"peg_{c}": 0.8 for c in "rgb"}, np.random.default_rng(0)
    truth, actions = space.from_dict(colours), rng.uniform(-1, 1, (1, 40, 3))
    rows = simulator.roll_out(truth[None], actions, rng).states[0]
    frames = simulator.render(rows, np.repeat(truth[None], len(rows), 0))
    start, shown = space.to_unit(truth), np.array([p.is_appearance for p in space])
    start[[space.names.index(f"peg_{c}") for c in "rgb"]] -= 0.45
    pictures = Pictures(frames=frames, full_states=rows)
    fit = fit_pictures(simulator, pictures, space.from_unit(start), np.flatnonzero(shown))
    np.testing.assert_allclose(fit.unit, space.to_unit(truth)[shown], atol=0.01)


def test_fit_to_budget_counts_particles_and_windows(simulator, monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])

    class TimedPhysics(Physics):
        """Every world's step takes a millisecond."""

        def play(self, states, units, actions, actuator_states=None):
            now_s[0] += 1e-3 * actions.shape[0] * actions.shape[1]
            return super().play(states, units, actions, actuator_states)

    rollouts = simulator.roll_out(
        SPACE.nominal[None], np.zeros((1, 1, 1)), np.random.default_rng(0)
    )
    physics = TimedPhysics(simulator, lambda batch: batch.qpos.copy(), rollouts.states[0, 0])
    shooting = ShootingConfig(num_windows=10_000)
    config, seconds = FitConfig(num_particles=10_000, shooting=shooting), 1000.0
    work = FitWork(1000, 2 * 2, 2)  # two joints' positions and velocities, a mass and a gain
    size = fit_to_budget(config, physics, SPACE.nominal, work, seconds)
    # Every window once as it is, by the state, and by the parameters up and down.
    derived = 1 + 2 * 2 + 2 * 2
    window_s = 2 * 1e-3 * shooting.steps_per_window(derived)  # from two sides
    window_s += 1e-3 * shooting.steps_of_longer(derived)  # from one
    num_windows = 84  # there are no more in so many steps, of 12 each
    particles_s, windows_s = 1e-3 * 1000 * 10_000, num_windows * window_s
    needed_s = particles_s + windows_s
    # Particles take the larger share of the two: seconds / needed_s
    assert size.num_particles == pytest.approx(10_000 * seconds / needed_s, rel=1e-3)
    assert size.shooting.num_windows == 20
    assert size.shooting.stages == shooting.stages
    # Where particles are cheap they take up to a quarter of the time, and windows the rest.
    cheap = replace(config, num_particles=100)  # 1 s each
    derived = 1 + 2 * 2 + 2 * 20
    all_s = 84e-3 * (2 * shooting.steps_per_window(derived) + shooting.steps_of_longer(derived))
    half_s = (100 + all_s) / 2
    size = fit_to_budget(cheap, physics, SPACE.nominal, work._replace(num_fitted=20), half_s)
    assert size.num_particles == int(half_s / 4) > 60
    windows = 84 * (half_s - half_s / 4) / all_s  # of the 84 that there are
    assert size.shooting.num_windows == pytest.approx(windows, abs=1)
    ample = fit_to_budget(config, physics, SPACE.nominal, work, 2 * needed_s)
    assert ample == config.at_most(10_000, 84)
    assert fit_to_budget(config, physics, SPACE.nominal, work, math.inf) == config
    # As few as tell enough, unless those take too long with all that is not counted, twice that
    few = config.at_most(0, 0)
    few_s = 1e-3 * 1000 * few.num_particles
    few_s += few.shooting.num_windows * window_s
    in_time = int(0.25 * 1.999 * few_s / 2)  # particles, of 1 s each
    for at_most_s, its in ((2.001 * few_s, few), (1.999 * few_s, config.least(in_time))):
        its = replace(its, longer_within_s=0.8 * at_most_s)
        assert fit_to_budget(config, physics, SPACE.nominal, work, 1e-3, at_most_s) == its
