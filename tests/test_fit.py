"""The fit of physics and pictures: known truths recovered, sums checked by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from simtune.fit.tracks import Tracks

from simtune.fit import sizing
from simtune.fit.bootstrap import Bootstrap, run_bootstrap
from simtune.fit.combine import FIRST_VARIANCE, Combined, combine
from simtune.fit.particles import ParticleConfig
from simtune.fit.physics import Physics
from simtune.fit.pictures import fit_pictures
from simtune.fit.result import FitResult, Misfit
from simtune.fit.shooting import Shooting, ShootingConfig, Stage
from simtune.fit.uncertainty import correlations, doubts, inflate
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.simulation import StateSpace, random_actions
from simtune.tasks import load_task
from simtune.tuning.range_update import RangeUpdateConfig, candidate_grid, read_curves, with_fit
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoints import find_keypoints

CARTPOLE = load_task("cartpole")
SPACE = CARTPOLE.parameters
MOVING = np.flatnonzero([not p.is_appearance for p in SPACE])
APPEARANCE = np.flatnonzero([p.is_appearance for p in SPACE])
MIDDLE = np.full(7, 0.5)  # of unit coordinates

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
    keypoints = find_keypoints(
        simulator, CARTPOLE.camera, Distribution.first(SPACE, SPACE.nominal), 0
    )
    truth = SPACE.clip(SPACE.nominal * np.where(SPACE.is_colour, 0.8, 1.3))
    actions = random_actions(3, 96, simulator.model, rng)
    rollouts = simulator.roll_out(np.repeat(truth[None], 3, 0), actions, rng, keypoints.observe)
    return keypoints, truth, rollouts


def tracks_of(rollouts, noise_px: float, mixed_up: float, rng) -> Tracks:
    """What the detector would see that is sometimes sure of another keypoint's place."""
    true = rollouts.observed.reshape(*rollouts.observed.shape[:2], -1, 2)
    seen = true + noise_px * rng.normal(size=true.shape)
    other = np.roll(seen, 1, axis=2)
    swapped = rng.random(seen.shape[:-1]) < mixed_up
    first = np.where(swapped[..., None], other, seen)
    second = np.where(swapped[..., None], seen, other)
    probability = np.full(first.shape[:-1], 1 - mixed_up)
    both = np.stack([probability, mixed_up + 0 * probability], 2) * 0.99
    return Tracks(np.stack([first, second], 2), both, rollouts.actions.astype(float))


def shooting(simulator, keypoints, rollouts, noise_px: float, fitted=MOVING) -> Shooting:
    config = ShootingConfig(stages=(Stage(4, 4, 4.0), Stage(12, 8)))
    noise = np.full(len(keypoints), noise_px)
    spread = np.array([0.1, 0.1, 0.5, 0.5])
    physics = Physics(simulator, keypoints, rollouts.states[0, 0])
    return Shooting(physics, noise, spread, fitted, config)


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


def test_a_change_of_state_and_the_difference_are_inverse():
    model, space, states, rng = some_states(0)
    tangent = 0.3 * rng.normal(size=(20, space.num_tangent))
    moved = space.move(states, tangent)
    np.testing.assert_allclose(space.difference(moved, states), tangent, atol=1e-9)
    position = states[0, : model.nq].copy()  # as MuJoCo itself integrates
    mujoco.mj_integratePos(model, position, tangent[0, : model.nv], 1.0)
    np.testing.assert_allclose(moved[0, : model.nq], position, atol=1e-9)


def test_features_describe_the_state():
    _, space, states, _ = some_states(1)
    again = space.from_features(space.features(states))
    np.testing.assert_allclose(space.difference(again, states), 0, atol=1e-6)
    turned = states.copy()
    turned[:, 11] += 2 * np.pi  # the unlimited hinge
    np.testing.assert_allclose(space.features(turned), space.features(states), atol=1e-9)


def test_experiments_are_weighed_by_their_variance_and_the_one_between_them():
    information = np.array([4.0, 1.0])  # variances ¼ and 1
    estimate = np.array([0.02, -0.01])
    told = combine(information[:, None, None], -(information * estimate)[:, None], 0.5, np.ones(2))
    weight = 1 / (1 / information + 0.5)
    best = -np.linalg.solve(told.information, told.slope)
    np.testing.assert_allclose(best, (weight @ estimate) / weight.sum(), rtol=1e-2)
    assert told.covariance.shape == (1, 1)


def test_one_experiment_that_claims_to_know_all_does_not_outweigh_the_others():
    information = np.full(30, 1e4)
    estimate = np.random.default_rng(0).normal(0, 0.01, 30)
    information[0], estimate[0] = 1e12, 0.5
    told = combine(
        information[:, None, None],
        -(information * estimate)[:, None],
        FIRST_VARIANCE,
        np.ones(30),
    )
    assert abs(told.step(MIDDLE[:1], 1.0)[0] - estimate[1:].mean()) < 0.005
    assert 0.001 < np.sqrt(told.covariance[0, 0]) < 0.01


def test_experiments_that_know_one_combination_only_and_that_well_can_be_combined():
    known = np.array([1.0, 2.0, 0, 0, 0, 0, 0])  # of seven parameters
    information = np.repeat(1e8 * np.outer(known, known)[None], 6, 0)
    slope = 1e4 * known * np.random.default_rng(0).normal(size=(6, 1))
    told = combine(information, slope, FIRST_VARIANCE, np.ones(6))
    assert np.abs(told.step(MIDDLE[:7], 1.0)).max() < 1e-3
    assert np.isfinite(told.covariance).all()


def test_a_single_experiment_is_no_surer_than_it_claims():
    claimed = 0.02**2
    covariance = combine(
        np.full((1, 1, 1), 1 / claimed), np.full((1, 1), 3.0), FIRST_VARIANCE, np.ones(1)
    ).covariance
    np.testing.assert_allclose(covariance, claimed, rtol=0.25)
    # Of many that agree better than they claim, their agreement counts.
    information, slope = np.full((60, 1, 1), 1 / claimed), np.full((60, 1), 1e-6)
    covariance = combine(information, slope, FIRST_VARIANCE, np.ones(60)).covariance
    assert covariance[0, 0] < 0.1 * claimed / 60


def test_a_step_leaves_what_stands_at_a_bound_and_is_best_for_the_others():
    # Down the valley of x + y; the bound of x is in the way, so that y goes alone.
    information = np.full((2, 2), 1e6)
    told = Combined(1e6 * np.array([0.02, 0.02]), information, np.eye(2), FIRST_VARIANCE)
    np.testing.assert_allclose(told.step(np.array([0.0, 0.5]), 1.0), [0, -0.02], rtol=1e-3)
    np.testing.assert_allclose(told.step(np.array([0.5, 0.5]), 1.0), [-0.01, -0.01], rtol=1e-3)
    # Too long a step keeps its direction.
    np.testing.assert_allclose(told.step(np.array([0.5, 0.5]), 0.001), [-0.001] * 2, rtol=1e-3)


def test_what_nothing_tells_stays_as_unknown_as_it_was():
    information = np.zeros((20, 2, 2))
    information[:, 0, 0] = 1e4  # of the first parameter only
    slope = np.zeros((20, 2))
    slope[:, 0] = np.random.default_rng(0).normal(0, 100, 20)
    told = combine(information, slope, FIRST_VARIANCE, np.ones(20))
    std = np.sqrt(np.diag(told.covariance))
    assert told.step(MIDDLE[:2], 1.0)[1] == 0
    assert std[0] < 0.02
    assert std[1] > 0.9  # of the whole range, in unit coordinates
    space = ParameterSpace([p for p in SPACE if not p.is_appearance])
    first = Distribution.first(space, space.nominal)
    flat = np.tile((1 - candidate_grid()).clip(0, 2) / 2, (2, 1))
    local = 2 * std / (space.to_unit(first.high) - space.to_unit(first.low))
    curves = with_fit(flat, np.zeros(2), local, RangeUpdateConfig())
    told, untold = read_curves(curves, first, first, RangeUpdateConfig()).verdict
    assert (told, untold) == ("identified", "not identifiable")
    estimate = read_curves(curves, first, first, RangeUpdateConfig())
    assert estimate.low[1] <= first.low[1]
    assert estimate.high[1] >= first.high[1]


def test_physics_is_found_from_keypoints(simulator, played):
    keypoints, truth, rollouts = played
    rng = np.random.default_rng(2)
    tracks = tracks_of(rollouts, 0.2, 0.1, rng)
    start = truth.copy()
    start[MOVING] *= [0.6, 1.5]
    found = shooting(simulator, keypoints, rollouts, 0.2).fit(
        tracks, rough_states(rollouts, rng), start
    )
    unit = SPACE.to_unit(truth)
    unit[MOVING] = found.unit
    np.testing.assert_allclose(SPACE.from_unit(unit)[MOVING], truth[MOVING], rtol=0.05)
    assert found.residual_px < 0.4
    deviation = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.unit - SPACE.to_unit(truth)[MOVING]) < 4 * deviation + 0.002).all()


def test_a_simulator_that_cannot_make_the_motion_fits_worse(simulator, played):
    keypoints, truth, rollouts = played
    rng = np.random.default_rng(3)
    tracks = tracks_of(rollouts, 0.2, 0.0, rng)
    states = rough_states(rollouts, rng)
    longer = CARTPOLE.load_spec()
    for geom in longer.geoms:
        if geom.name == "pole_1":
            geom.fromto = [*geom.fromto[:5], 1.3 * geom.fromto[5]]
    none = MOVING[:0]
    right = shooting(simulator, keypoints, rollouts, 0.2, none).fit(tracks, states, truth)
    other = replace(CARTPOLE, load_spec=lambda: longer).simulator(image_size=48)
    wrong = shooting(other, keypoints, rollouts, 0.2, none).fit(tracks, states, truth)
    assert wrong.residual_px > 1.5 * right.residual_px


def test_colours_are_found_from_pixels(simulator, played):
    _, truth, rollouts = played
    rows = rollouts.states[:, ::12].reshape(-1, rollouts.states.shape[-1])
    frames = simulator.render(rows, np.repeat(truth[None], len(rows), 0))
    start = truth.copy()
    start[APPEARANCE] = np.clip(truth[APPEARANCE] + [0.2, -0.2, 0.2, -0.2, 0.2, -0.2], 0, 1)
    found = fit_pictures(simulator, frames, rows, start, APPEARANCE)
    np.testing.assert_allclose(found.unit, truth[APPEARANCE], atol=0.005)


def test_colours_far_off_are_found_though_most_pictures_show_other_states(simulator, played):
    _, truth, rollouts = played
    rows = rollouts.states[:, ::8].reshape(-1, rollouts.states.shape[-1])
    frames = simulator.render(rows, np.repeat(truth[None], len(rows), 0))
    lost = np.random.default_rng(0).random(len(rows)) < 0.6
    moved = rows.copy()
    moved[lost, 1] += 0.3  # m, of the cart
    start = SPACE.to_unit(truth)
    start[APPEARANCE] -= 0.12
    fit = fit_pictures(simulator, frames, moved, SPACE.from_unit(start), APPEARANCE)
    np.testing.assert_allclose(fit.unit, SPACE.to_unit(truth)[APPEARANCE], atol=0.01)


def a_fit(motion_px: float = 0.3, picture: float = 0.004, lag: int = 0) -> FitResult:
    correlation = np.array([[1, 0.9], [0.9, 1]])
    misfit = Misfit(motion_px, picture)
    std = np.full(len(SPACE), 0.01)
    return FitResult(SPACE.nominal, std, correlation, MOVING, misfit, np.zeros(1), lag)


def replicas_of(errors: np.ndarray) -> Bootstrap:
    is_moving = ~np.isin(np.arange(len(SPACE)), APPEARANCE)
    return Bootstrap(errors, is_moving, [a_fit().misfit] * len(errors))


def test_windows_are_counted_by_what_the_motion_is_fitted_to(simulator, monkeypatch):
    """Colours, of which a cartpole has six, are derived by elsewhere."""
    monkeypatch.setattr(sizing, "_seconds_per_step", lambda *_: (1e-3, 1e-3))
    shooting, seconds = ShootingConfig(num_windows=10_000), 1000.0
    first = Distribution.first(SPACE, SPACE.nominal)
    keypoints = find_keypoints(simulator, CARTPOLE.camera, first, 0)
    asked = (ParticleConfig(), shooting, simulator, keypoints, SPACE.nominal, 1000, seconds)
    _, afforded = sizing.fit_to_budget(*asked)
    played = 3 + 2 * 2 + 2  # and by two joints' positions and velocities, a mass and a gain
    once_s = 1e-3 * played * shooting.steps_per_window * 2
    assert afforded.num_windows == int(0.4 * seconds / once_s)


def test_replicas_say_how_much_too_sure_a_fit_is():
    errors = np.random.default_rng(0).normal(size=(40, len(SPACE)))
    np.testing.assert_allclose(replicas_of(errors).inflation(), 1, atol=0.5)
    np.testing.assert_allclose(replicas_of(3 * errors).inflation(), 3, atol=1)
    assert (replicas_of(errors[:0]).inflation() == 3).all()  # nothing known: careful


@pytest.mark.parametrize("size", [0.7, 1.0, 2.5])
@pytest.mark.parametrize("num_replicas", [2, 6])
def test_few_replicas_make_intervals_that_hold_as_often_as_they_say(num_replicas, size):
    rng, held = np.random.default_rng(0), []
    for _ in range(400):
        errors = size * rng.normal(size=(num_replicas + 1, len(SPACE)))
        width = 1.645 * replicas_of(errors[1:]).inflation()
        held.append(np.abs(errors[0]) < width)
    moving, others = np.mean(held, 0)[MOVING], np.mean(held, 0)[APPEARANCE]
    assert 0.86 < others.mean() < 0.97
    # Of what moves a fit is never taken to be surer than it says.
    assert 0.85 < moving.mean() < (0.97 if size >= 1 else 1)


def test_replicas_that_went_astray_do_not_count_and_none_is_drawn_from_farther_than_was_known(
    simulator,
):
    real = replace(a_fit(), std=np.full(len(SPACE), 5.0))  # the fit says nothing at all
    guess_std, filmed, distances = np.full(len(SPACE), 0.02), [], [0.3, 0.6, 0.4]

    class FakeReplay:
        def fit(self, frames, actions, start, start_std, lag, grow):
            filmed.append(SPACE.to_unit(start))
            return replace(real, misfit=Misfit(distances[len(filmed) - 1], 0.0))

    actions, rng, near = np.zeros((1, 4, 1)), np.random.default_rng(0), real.parameters

    def made_of(num: int, guess: np.ndarray = near) -> Bootstrap:
        return run_bootstrap(
            FakeReplay(), simulator, real, actions, num, guess, guess_std, None, rng
        )

    made = made_of(3)
    assert made.errors.shape == (2, len(SPACE))
    assert [misfit.motion_px for misfit in made.misfits] == distances
    unit = SPACE.to_unit(real.parameters)
    assert np.abs(np.array(filmed) - unit).max() < 0.15  # a truth's and a guess's distance

    distances[:] = [0.6, 0.7, 0.8]  # where all of them went astray, so may the real one
    filmed.clear()
    assert made_of(3).errors.shape == (3, len(SPACE))
    assert made_of(0).errors.shape == (0, len(SPACE))

    filmed.clear()  # but a fit that had to go far is compared with others that have to
    made_of(3, SPACE.from_unit(unit - 0.2))
    assert np.abs(np.array(filmed) - unit).max() > 0.2


def test_intervals_widen_where_the_videos_fit_worse_than_simulated_ones():
    replicas = replicas_of(np.zeros((8, len(SPACE))))
    same = inflate(a_fit(), replicas, True).std
    worse = inflate(a_fit(motion_px=0.6, picture=0.012), replicas, True).std
    np.testing.assert_allclose(worse[MOVING] / same[MOVING], 2)
    np.testing.assert_allclose(worse[APPEARANCE] / same[APPEARANCE], 3)
    through_a_camera = inflate(a_fit(), replicas, False).std
    factor, said = replicas.inflation(), a_fit().std
    expected = factor * np.hypot(said, np.where(a_fit().is_moving, 0.005, 0.035))
    np.testing.assert_allclose(through_a_camera, expected)
    np.testing.assert_allclose(same, factor * said)


def test_what_a_camera_does_to_all_colours_alike_widens_those_of_thin_things_no_more(simulator):
    """Fits that see a colour to .001 or to .01 are both off by what the camera does."""
    unit = SPACE.to_unit(SPACE.nominal)
    std = np.where(np.arange(len(SPACE)) % 2, 0.001, 0.01)
    rng = np.random.default_rng(0)

    class FakeReplay:
        def fit(self, frames, actions, start, start_std, lag, grow):
            off = np.where(np.isin(np.arange(len(SPACE)), APPEARANCE), 0.05 * rng.normal(), 0.0)
            truth = SPACE.to_unit(start)  # guessed exactly, below
            return replace(a_fit(), parameters=SPACE.from_unit(truth + off), std=std)

    real = replace(a_fit(), parameters=SPACE.from_unit(unit), std=std)
    still, exact = np.zeros((1, 4, 1)), np.zeros(len(SPACE))
    made = run_bootstrap(
        FakeReplay(), simulator, real, still, 6, SPACE.nominal, exact, ImageNoise(), rng
    )
    wide = inflate(real, made, False).std[APPEARANCE]
    assert 0.03 < wide.min() <= wide.max() < 0.12


def test_where_sight_is_sure_of_nothing_nothing_is_sure():
    replicas = replicas_of(np.zeros((2, len(SPACE))))
    lost = a_fit(motion_px=float("nan"))
    assert np.isinf(inflate(lost, replicas, True).std[MOVING]).all()
    assert np.isfinite(inflate(lost, replicas, True).std[APPEARANCE]).all()
    nowhere = replace(replicas, misfits=[lost.misfit] * 2)
    for known in (nowhere, replace(replicas, misfits=[])):  # nothing to compare with
        assert np.isfinite(inflate(lost, known, True).std).all()
        assert doubts(lost, known) == []
    one_lost = replace(replicas, misfits=[lost.misfit, a_fit().misfit])
    assert doubts(a_fit(motion_px=0.9), one_lost), "a replica that was lost silences nothing"


def test_what_is_doubtful_is_said():
    replicas = replicas_of(np.zeros((8, len(SPACE))))
    assert doubts(a_fit(), replicas) == []
    (told,) = doubts(a_fit(motion_px=0.9), replicas)
    assert "3.0 times" in told
    (told,) = doubts(a_fit(motion_px=float("nan")), replicas)
    assert "nothing that moves is found for sure" in told
    (told,) = doubts(a_fit(lag=1), replicas)
    assert "1 step later" in told
    assert correlations(a_fit(), SPACE.names) == {"pole_mass, actuator_gain": 0.9}
