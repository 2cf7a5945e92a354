"""The bootstrap, and how it widens intervals: known refits, sums by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from search_context import context_of, record_episodes

from simtune.budget import Budget, OutOfTime
from simtune.fit import (
    FitResult,
    Observed,
    PointEstimate,
    Refits,
    bound_warnings,
    calibrated,
    correlated_pairs,
    delay_warnings,
    held_out_misfit,
    model_checks,
    run_bootstrap,
    what_is_unexplained,
)
from simtune.fit.calibration.refits import believed_std, usual_std
from simtune.fit.combine import COMMON_STD
from simtune.fit.lateness import is_too_late
from simtune.fit.motion.common_errors import Beside, beside
from simtune.fit.pictures.response import CameraResponse, Photometry
from simtune.fit.result import Misfit, block_correlation
from simtune.observation import AllEvidence, ObservationModel
from simtune.parameters import ParameterSpace, camera_pose
from simtune.randomization import Distribution
from simtune.search_param_model.posterior import PosteriorConfig, PosteriorSearchParamModel
from simtune.simulation import Rollouts
from simtune.tasks import load_task
from simtune.tuning.earlier_rounds import EarlierRounds
from simtune.tuning.estimate import Estimate
from simtune.tuning.fit_verdict import conclude
from simtune.tuning.fitting import Fitted, Fitting
from simtune.tuning.joint import Joint
from simtune.tuning.judging import Judging
from simtune.tuning.observing import Observing
from simtune.tuning.refit_plan import RefitPlan
from simtune.tuning.rounds import RoundTime
from simtune.tuning.search import NO_CALLBACKS
from simtune.tuning.survival_curves import normal_curves
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.image_noise import ImageNoise
from simtune.vision.keypoint_tracks import KeypointTracks

SPACE = load_task("cartpole").parameters
APPEARANCE = np.flatnonzero([p.is_appearance for p in SPACE])
MOVING = np.flatnonzero([not p.is_appearance for p in SPACE])
NOTHING = np.zeros(len(SPACE))
KEYPOINTS, ANGLE = ("keypoints", "px"), ("angle", "rad")


def correlated(one: str, other: str, value: float) -> np.ndarray:
    correlation = np.eye(len(SPACE))
    i, j = SPACE.index(one), SPACE.index(other)
    correlation[i, j] = correlation[j, i] = value
    return correlation


def a_misfit(*motion: float, picture: float | np.ndarray = 0.004) -> Misfit:
    return Misfit(motion, tuple(np.broadcast_to(picture, len(APPEARANCE)).tolist()))


def a_fit(
    motion: float = 0.3, picture: float | np.ndarray = 0.004, latency_steps: int = 0
) -> FitResult:
    return FitResult(
        parameters=SPACE.nominal,
        std=np.full(len(SPACE), 0.01),
        discrepancy_std=NOTHING,
        correlation=correlated("pole_mass", "actuator_gain", 0.9),
        is_moving=np.isin(np.arange(len(SPACE)), MOVING),
        misfit=a_misfit(motion, picture=picture),
        sensors=(KEYPOINTS,),
        starts=np.zeros((1, 1)),
        latency_steps=latency_steps,
        rough_std=np.where(np.isin(np.arange(len(SPACE)), MOVING), 0.02, 0.0),
        offsets=np.zeros(0),
        known=np.zeros(0, int),
        responses=[],
    )


def refits_of(errors: np.ndarray) -> Refits:
    is_moving = ~np.isin(np.arange(len(SPACE)), APPEARANCE)
    return Refits(errors, is_moving, [a_fit().misfit] * len(errors), a_fit().std)


class FakeReplayFit:
    """Finds what it is told to, wherever it starts."""

    space = SPACE

    def __init__(self, find):
        """`find(start)`: a `FitResult` for the (N,) parameters where a fit begins."""
        self.find, self.starts = find, []

    def within(self, budget: Budget) -> "FakeReplayFit":
        return self

    def fit(self, observed, start: PointEstimate, latencies: tuple[int]):
        self.starts.append(SPACE.to_unit(start.parameters))
        return self.find(start.parameters)


def observe_nothing(parameters: np.ndarray, latency_steps: int) -> Observed:
    return Observed(AllEvidence(()), np.zeros((1, 4, 1)))


def test_inflation_is_how_much_too_sure_a_fit_is():
    errors = np.random.default_rng(0).normal(size=(40, len(SPACE)))
    np.testing.assert_allclose(refits_of(errors).inflation(), 1, atol=0.5)
    np.testing.assert_allclose(refits_of(3 * errors).inflation(), 3, atol=1)
    assert (refits_of(errors[:0]).inflation() == 3).all()  # nothing known: careful


@pytest.mark.parametrize("size", [0.7, 1.0, 2.5])
@pytest.mark.parametrize("num_refits", [2, 6])
def test_intervals_inflated_by_few_refits_cover_as_often_as_they_say(num_refits, size):
    rng, held = np.random.default_rng(0), []
    for _ in range(400):
        errors = size * rng.normal(size=(num_refits + 1, len(SPACE)))
        known = refits_of(errors[1:])
        held.append(np.abs(errors[0] - known.bias()) < 1.645 * known.inflation())
    moving, others = np.mean(held, 0)[MOVING], np.mean(held, 0)[APPEARANCE]
    # Two alone do not outweigh what is expected of fits before any refit.
    least = 0.86 if num_refits > 2 else 0.8
    assert least < moving.mean() < 0.98
    assert least < others.mean() < 0.98


def test_bias_is_what_errors_share_as_far_as_it_stands_out_from_chance():
    errors = np.zeros((4, len(SPACE)))
    errors[:, 0], errors[:, 1] = [1.0, 1.2, 0.8, 1.0], [1.0, -1.0, 0.5, -0.5]
    bias = refits_of(errors).bias()
    # By hand: squares .08, and two of what is claimed; (.08 + 2) / (3 + 2) / 4 = .104 of variance.
    # The lower quartile is .95
    assert bias[0] == pytest.approx(0.95 * (1.0 - 0.104))
    assert (bias[1:] == 0).all()
    assert (refits_of(errors[:2]).bias() == 0).all()  # two may well agree by chance
    errors[:, 2] = [-3.0, 0.1, -2.5, -0.1]  # half of them did not arrive, from one side
    # The upper quartile is −.05, the mean −1.375, and its variance (7.71 + 2) / 5 / 4 = .485.
    expected = -0.05 * (1 - 0.485 / 1.375**2)
    assert refits_of(errors).bias()[2] == pytest.approx(expected, rel=1e-2)
    wild = np.vstack([errors, 100 * np.ones(len(SPACE))])
    assert refits_of(wild).bias().max() < 1.5


def test_what_all_refits_share_is_taken_off_and_narrows_what_is_left():
    rng, off, left, held = np.random.default_rng(0), [], [], []
    for _ in range(300):
        errors = 1.0 + 0.5 * rng.normal(size=(7, len(SPACE)))
        known = refits_of(errors[1:])
        off.append(np.abs(errors[0]))
        left.append(np.abs(errors[0] - known.bias()))
        held.append(left[-1] < 1.645 * known.inflation())
    assert np.median(left) < 0.5 * np.median(off)
    assert 0.88 < np.mean(held) < 0.99


def test_judged_moves_the_estimate_by_the_bias_unless_the_real_fit_is_worse():
    known = replace(refits_of(np.full((8, len(SPACE)), 1.0)), misfits=[a_misfit(0.3)] * 8)
    for motion, share in ((0.3, 1.0), (0.6, 0.5)):
        fit = a_fit(motion=motion, picture=0.004)
        moved = SPACE.to_unit(calibrated(fit, known, SPACE).parameters) - SPACE.to_unit(
            fit.parameters
        )
        claimed = np.hypot(known.believed(fit.std), fit.discrepancy_std)
        expected = -known.bias() * claimed
        np.testing.assert_allclose(moved[MOVING], share * expected[MOVING], rtol=1e-6)
        np.testing.assert_allclose(moved[APPEARANCE], expected[APPEARANCE], rtol=1e-6)


def test_ranks_by_hand_use_the_inflation_of_the_other_refits():
    errors = np.array([[0.0] * len(SPACE), [1.0] * len(SPACE), [-2.0] * len(SPACE)])
    ranks = np.array(list(refits_of(errors).ranks(SPACE.names).values())).T
    assert ranks.shape == errors.shape
    np.testing.assert_allclose(ranks[0], 0.5)
    assert (ranks[1] < 0.5).all()  # the estimate was too high: the truth is low in its curve
    assert (ranks[2] > ranks[0]).all()


def test_astray_refits_are_left_out_unless_all_are():
    real, distances = a_fit(), [0.3, 0.6, 0.4]
    replay_fit = FakeReplayFit(
        lambda _: replace(real, misfit=a_misfit(distances[len(replay_fit.starts) - 1], picture=0.0))
    )

    def bootstrap(num: int) -> Refits:
        replay_fit.starts.clear()
        start = PointEstimate(real.parameters, np.full(len(SPACE), 0.02))
        return run_bootstrap(
            replay_fit, observe_nothing, real, start, num, np.random.default_rng(0)
        )

    made = bootstrap(3)
    assert made.errors.shape == (2, len(SPACE))
    assert [misfit.motion[0] for misfit in made.misfits] == [0.3, 0.4]
    assert made.motion_ratios(a_misfit(0.6)) == pytest.approx(
        [1.5]
    )  # not of the worst, which tells nothing
    distances[:] = [0.6, 0.7, 0.8]  # where all of them went astray, so may the real one
    assert bootstrap(3).errors.shape == (3, len(SPACE))
    assert bootstrap(0).errors.shape == (0, len(SPACE))


def test_refit_astray_in_any_sensor_is_left_out():
    two = replace(a_fit(), misfit=a_misfit(0.3, 0.01, picture=0.0), sensors=(KEYPOINTS, ANGLE))
    motions = iter([(0.3, 0.01), (0.3, 0.02), (float("nan"), 0.01)])
    replay_fit = FakeReplayFit(lambda _: replace(two, misfit=a_misfit(*next(motions), picture=0.0)))
    start = PointEstimate(two.parameters, np.full(len(SPACE), 0.02))
    made = run_bootstrap(replay_fit, observe_nothing, two, start, 3, np.random.default_rng(0))
    assert made.errors.shape == (2, len(SPACE))


def test_a_refit_that_runs_out_of_time_is_the_last_and_does_not_count():
    def find(_: np.ndarray) -> FitResult:
        if len(replay_fit.starts) == 3:
            raise OutOfTime
        return a_fit()

    replay_fit = FakeReplayFit(find)
    start = PointEstimate(SPACE.nominal, np.full(len(SPACE), 0.02))
    made = run_bootstrap(replay_fit, observe_nothing, a_fit(), start, 6, np.random.default_rng(0))
    assert (len(made.errors), len(replay_fit.starts)) == (2, 3)


def test_another_world_is_known_where_one_diverges():
    """At most three each; starts stay on both sides."""
    real = replace(a_fit(), parameters=SPACE.from_unit(np.full(len(SPACE), 0.5)))
    films = observe_nothing(NOTHING, 0)
    answers = iter([None, films, None, None, None, films])
    replay_fit = FakeReplayFit(lambda begun_at: replace(real, parameters=begun_at))
    start = PointEstimate(real.parameters, np.full(len(SPACE), 0.02))
    made = run_bootstrap(
        replay_fit, lambda *_: next(answers), real, start, 3, np.random.default_rng(0)
    )
    assert (len(made.errors), len(made.misfits), len(replay_fit.starts)) == (2, 2, 2)
    assert made.num_diverged == 1
    assert Refits.from_json(made.to_json()).num_diverged == 1
    assert model_checks(real, replace(made, misfits=made.misfits * 4)) == []


def test_known_worlds_that_all_diverge_are_told_and_not_a_lack_of_time():
    replay_fit = FakeReplayFit(lambda _: a_fit())
    start = PointEstimate(SPACE.nominal, np.full(len(SPACE), 0.02))
    rng = np.random.default_rng(0)
    made = run_bootstrap(replay_fit, lambda *_: None, a_fit(), start, 2, rng)
    (warning,) = model_checks(a_fit(), made)
    assert "All known worlds that were to be fitted for comparison diverged" in warning
    assert "minutes" not in warning
    (warning,) = model_checks(a_fit(), Refits.none(a_fit()))
    assert "There was no time to fit a known world" in warning


def test_refit_worlds_are_drawn_no_farther_than_was_known_before():
    real = replace(a_fit(), std=np.full(len(SPACE), 5.0))  # the fit says nothing at all
    unit, truths = SPACE.to_unit(real.parameters), []

    def synthesize(parameters: np.ndarray, latency_steps: int) -> Observed:
        truths.append(SPACE.to_unit(parameters))
        return observe_nothing(parameters, latency_steps)

    replay_fit = FakeReplayFit(lambda _: real)
    start = PointEstimate(real.parameters, np.full(len(SPACE), 0.02))
    run_bootstrap(replay_fit, synthesize, real, start, 8, np.random.default_rng(0))
    free = (unit > 0.1) & (unit < 0.9)
    assert 0.01 < (np.array(truths) - unit)[:, free].std() < 0.03
    # Refits start as far from the truth as the real one's fit did.
    away = np.array(replay_fit.starts) - truths
    assert 0.01 < away[:, free].std() < 0.03
    replay_fit.starts.clear()
    truths.clear()
    far = PointEstimate(SPACE.from_unit(unit - 0.2), start.std)
    run_bootstrap(replay_fit, synthesize, real, far, 8, np.random.default_rng(0))
    assert np.abs(np.array(replay_fit.starts) - unit).max() > 0.2


def test_fits_that_do_not_arrive_are_not_taken_for_biased_to_the_side_where_they_began():
    """Five independent beginnings all lie on one side of the truth once in sixteen times."""
    real = replace(a_fit(), parameters=SPACE.from_unit(np.full(len(SPACE), 0.5)))
    start = PointEstimate(real.parameters, np.full(len(SPACE), 0.05))
    replay_fit = FakeReplayFit(lambda begun_at: replace(real, parameters=begun_at))
    for seed in range(20):
        rng = np.random.default_rng(seed)
        made = run_bootstrap(replay_fit, observe_nothing, real, start, 4, rng)
        assert np.abs(made.errors).max() > 1
        assert (made.bias() == 0).all()
        np.testing.assert_allclose(made.errors[::2], -made.errors[1::2], atol=1e-9)


def test_refit_errors_are_in_units_of_the_claimed_std():
    std, discrepancy = np.full(len(SPACE), 0.03), np.full(len(SPACE), 0.04)
    unit = SPACE.to_unit(SPACE.nominal).clip(0.2, 0.8)
    begun_at = SPACE.from_unit(unit)
    fit = replace(a_fit(), parameters=begun_at, std=std, discrepancy_std=discrepancy)
    truths = []

    def synthesize(parameters: np.ndarray, latency_steps: int) -> Observed:
        truths.append(SPACE.to_unit(parameters))
        return observe_nothing(parameters, latency_steps)

    start = PointEstimate(begun_at, std)
    made = run_bootstrap(
        FakeReplayFit(lambda _: fit), synthesize, fit, start, 4, np.random.default_rng(0)
    )
    np.testing.assert_allclose(made.believed(std)[APPEARANCE], 0.03)
    camera = np.where(fit.is_moving, 0, 0.04)  # refits have no other discrepancy
    claimed = np.hypot(made.believed(std), camera)
    np.testing.assert_allclose(made.errors, (unit - np.array(truths)) / claimed, atol=1e-9)


def test_a_claim_smaller_than_usual_is_luck_and_a_larger_one_counts_by_half():
    known = replace(refits_of(np.zeros((3, 3))), usual_std=np.full(3, 0.02))
    np.testing.assert_allclose(known.believed(np.array([0.002, 0.02, 0.08])), [0.02, 0.02, 0.04])
    unknown = replace(known, errors=np.zeros((0, 3)))
    np.testing.assert_allclose(unknown.believed(np.array([0.002, 0.02, 0.08])), [0.02, 0.02, 0.08])


def test_intervals_hold_though_claims_vary_by_chance():
    rng, off = np.random.default_rng(0), []
    fit, rough = a_fit(), np.full((3, len(SPACE)), 0.02)
    for _ in range(400):
        errors = 0.005 * rng.normal(size=(3, len(SPACE)))
        claims = 0.005 * np.exp(0.8 * rng.normal(size=errors.shape))
        usual = usual_std(claims[1:], replace(fit, std=claims[0]), rough)
        ratios = errors[1:] / believed_std(claims[1:], usual, 2)
        known = replace(refits_of(ratios), usual_std=usual)
        off.append(np.abs(errors[0]) / known.believed(claims[0]) / known.inflation())
    assert 0.9 < (np.array(off)[:, MOVING] < 1.645).mean() < 0.98
    assert np.quantile(np.array(off)[:, MOVING], 0.98) < 2.4  # 2.9 if small claims count by half


def test_intervals_widen_where_reality_fits_worse_than_refits():
    refits = refits_of(np.zeros((8, len(SPACE))))
    same = calibrated(a_fit(), refits, SPACE).std
    worse = calibrated(a_fit(motion=0.6, picture=0.012), refits, SPACE).std
    np.testing.assert_allclose(worse[MOVING] / same[MOVING], 2)
    np.testing.assert_allclose(worse[APPEARANCE] / same[APPEARANCE], 3**0.5)
    np.testing.assert_allclose(same, refits.inflation() * a_fit().std)


def test_a_colour_whose_own_pixels_are_not_explained_is_told_less_and_others_as_well_as_before():
    refits = refits_of(np.zeros((8, len(SPACE))))
    noise = np.where(np.arange(len(APPEARANCE)) == 1, 0.02, 0.004)
    wider = (
        calibrated(a_fit(picture=noise), refits, SPACE).std / calibrated(a_fit(), refits, SPACE).std
    )
    np.testing.assert_allclose(wider, np.where(np.arange(len(SPACE)) == APPEARANCE[1], 5**0.5, 1))


def test_what_is_drawn_elsewhere_is_told_less_and_so_is_the_motion():
    """Hand arithmetic: pixels 16 times as noisy as in any refit, and a tenth of the scale off."""
    first = Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    refits, last = refits_of(np.zeros((8, len(SPACE)))), APPEARANCE[-1]
    usual = calibrated(a_fit(), refits, SPACE).std

    def of(noise: float) -> FitResult:
        return a_fit(picture=np.where(np.array(APPEARANCE) == last, noise, 0.004))

    wider = calibrated(of(0.064), refits, SPACE).std / usual
    np.testing.assert_allclose(wider[MOVING], 4)
    np.testing.assert_allclose(wider[APPEARANCE[:-1]], 1)
    assert wider[last] == pytest.approx(16)
    found, _ = conclude(curves, of(0.064), refits, first, first)
    at_most_weak = np.isin(np.arange(len(SPACE)), [*MOVING, last])
    np.testing.assert_array_equal(np.array(found.verdict) == "identified", ~at_most_weak)
    (warning,) = found.warnings
    assert warning.startswith(f"What shows {SPACE.names[last]} is not where the fit has it")
    assert "16 of 255 levels off, 16 times as far" in warning
    alike, _ = conclude(curves, of(0.023), refits, first, first)
    assert alike.warnings == []  # six times as noisy: as another renderer draws it


def test_known_worlds_begin_where_the_real_episodes_did():
    """Elsewhere, the same actions might push nothing of what they pushed."""
    simulator, played = load_task("cartpole").simulator(image_size=32), []
    context, roll_out = context_of(simulator), simulator.roll_out

    def watched(*given) -> Rollouts:
        played.append(roll_out(*given))
        return played[-1]

    simulator.roll_out = watched
    (real,) = record_episodes(simulator, 1)
    num, config = len(context.keypoints), PosteriorConfig()
    scale, visible, shape = simulator.action_scale, SPACE.is_visible, simulator.shape
    model = PosteriorSearchParamModel(num, scale, visible, shape, config, 0)
    nothing = np.zeros((num, 2))
    exact = DetectorNoise(np.zeros((num, 1)), np.ones((num, 1)), nothing, nothing)
    rng = np.random.default_rng(0)
    begun = roll_out(np.repeat(SPACE.nominal[None], 4, 0), np.ones((4, 5, 1)), rng).states[:, 5]
    fit = replace(a_fit(), starts=begun)
    known = FakeReplayFit(lambda _: fit)
    observing = Observing(context, exact, AllEvidence(()))
    observed = observing.observed([real] * 4, [model.detect(real.frames)] * 4)
    start = PointEstimate(SPACE.nominal, np.full(len(SPACE), 0.02))
    facts: dict[str, Any] = {
        "replay_fit": known,
        "observing": observing,
        "start": start,
        "learning": SimpleNamespace(model=model, worlds=SimpleNamespace(rng=rng)),
        "learned": None,
    }
    fitting = Fitting(**facts, finds_latency=False, may_give_up=False)
    made = fitting.refit(Fitted(fit, known, observing, 1.0), observed, RefitPlan(2, 3), Budget())
    assert len(made.errors) == len(played) == 2
    for world in played:
        np.testing.assert_array_equal(world.states[:, 0], begun[:3])


def test_what_fits_usually_claim_is_the_mean_of_all_of_them_and_of_what_is_expected():
    claims = iter([0.004, 0.02, 0.2])
    replay_fit = FakeReplayFit(lambda _: replace(a_fit(), std=np.full(len(SPACE), next(claims))))
    start = PointEstimate(SPACE.nominal, np.full(len(SPACE), 0.02))
    surest = replace(a_fit(), std=np.full(len(SPACE), 0.002))
    made = run_bootstrap(replay_fit, observe_nothing, surest, start, 3, np.random.default_rng(0))
    claimed = 0.004 * 0.02 * 0.2 * 0.002  # by the fit that is judged, too
    # What is usual before any refit, .005, counts like two of what moves.
    usual = np.where(made.is_moving, (claimed * 0.005**2) ** (1 / 6), claimed ** (1 / 4))
    std = calibrated(surest, made, SPACE).std / made.inflation()
    np.testing.assert_allclose(std, usual)
    unsure = replace(a_fit(), std=np.full(len(SPACE), 0.05))
    std = calibrated(unsure, made, SPACE).std / made.inflation()
    np.testing.assert_allclose(std, np.sqrt(0.05 * usual))


def test_a_fit_without_refits_is_no_surer_than_fits_usually_are():
    replay_fit = FakeReplayFit(lambda _: a_fit())
    start = PointEstimate(SPACE.nominal, np.full(len(SPACE), 0.02))

    def alone(fit: FitResult) -> np.ndarray:
        rng = np.random.default_rng(0)
        made = run_bootstrap(replay_fit, observe_nothing, fit, start, 0, rng)
        return calibrated(fit, made, SPACE).std / made.inflation()

    surest = replace(a_fit(), std=np.full(len(SPACE), 0.0005))
    np.testing.assert_allclose(alone(surest)[MOVING], 0.005)
    np.testing.assert_allclose(alone(surest)[APPEARANCE], 0.0005)
    # ... but no more than .4 of how far off it began
    began_well = replace(surest, rough_std=surest.rough_std / 10)
    np.testing.assert_allclose(alone(began_well)[MOVING], 0.4 * 0.002)
    np.testing.assert_allclose(alone(a_fit()), 0.01)  # knows itself to be unsure


@pytest.mark.parametrize("size", [0.2, 3.0])
def test_many_refits_narrow_what_is_claimed_too_wide_and_widen_what_is_too_sure(size):
    errors = size * np.random.default_rng(0).normal(size=(8, len(SPACE)))
    np.testing.assert_allclose(refits_of(errors).inflation() / size, 1.4, atol=0.6)


def test_each_parameter_is_judged_by_its_own_refits_beside_those_of_its_kind():
    errors = np.random.default_rng(0).normal(size=(8, len(SPACE)))
    errors[:, APPEARANCE[0]] *= 0.1
    found = refits_of(errors).inflation()[APPEARANCE]
    assert found[0] < 0.7 * found[1:].min()


def test_the_worst_sensor_widens_intervals():
    refits = refits_of(np.zeros((8, len(SPACE))))
    refits = replace(refits, misfits=[a_misfit(0.3, 0.01)] * 8)
    fit = replace(a_fit(), sensors=(KEYPOINTS, ANGLE), misfit=a_misfit(0.3, 0.05))
    assert refits.motion_ratios(fit.misfit) == pytest.approx([1, 5])
    std = calibrated(fit, refits, SPACE).std
    np.testing.assert_allclose(std[MOVING], 5 * refits.inflation()[MOVING] * 0.01)
    np.testing.assert_allclose(std[APPEARANCE], refits.inflation()[APPEARANCE] * 0.01)
    held = {
        "sensors": {
            "keypoints": {"unit": "px", "distance": 0.3, "known_worlds": [0.3] * 8},
            "angle": {"unit": "rad", "distance": 0.05, "known_worlds": [0.01] * 8},
        }
    }
    told = held_out_misfit(replace(fit, held_out=4), refits)
    assert told == {"episode": 5, "passed": False} | held
    alike = replace(fit, misfit=a_misfit(0.3, 0.01))
    assert held_out_misfit(alike, refits)["passed"]
    assert held_out_misfit(alike, refits)["episode"] is None
    assert held_out_misfit(fit, replace(refits, misfits=[]))["passed"] is None
    (warning,) = model_checks(fit, refits)
    assert "they are 0.05 rad apart (angle), 5.0 times as far as" in warning


def test_a_real_camera_widens_intervals_by_its_discrepancy():
    refits = refits_of(np.zeros((8, len(SPACE))))
    filmed = ObservationModel.of_reality().discrepancy_std(SPACE.is_appearance)
    simulated = ObservationModel.of_simulator().discrepancy_std(SPACE.is_appearance)
    np.testing.assert_array_equal(simulated, 0)
    np.testing.assert_allclose(filmed, np.where(a_fit().is_moving, 0.005, 0.02))
    fit = replace(a_fit(), discrepancy_std=filmed)
    off = refits_of(np.resize([[1.5], [-1.5]], (8, 1)) * np.ones(len(SPACE)))
    # Refits have cameras, and no other discrepancy
    widened = np.where(
        fit.is_moving,
        np.hypot(off.inflation() * 0.01, filmed),
        off.inflation() * np.hypot(0.01, filmed),
    )
    np.testing.assert_allclose(calibrated(fit, off, SPACE).std, widened)
    # Refits that all find the truth do not know what the camera does.
    factor = refits.inflation()
    assert factor.max() < 0.7
    sure = np.full(len(SPACE), 0.001)
    exact = calibrated(replace(fit, std=sure), replace(refits, usual_std=sure), SPACE).std
    of_motion = np.hypot(0.001 * factor, filmed)
    np.testing.assert_allclose(exact, np.where(fit.is_moving, of_motion, filmed))


def test_intervals_of_the_motion_hold_though_refits_have_no_discrepancy():
    """Errors of fits are normal, as claimed; in reality the discrepancy comes on top."""
    discrepancy = ObservationModel.of_reality().discrepancy_std(SPACE.is_appearance)
    rng, held = np.random.default_rng(0), []
    usual = replace(a_fit(), std=np.full(len(SPACE), 0.005), discrepancy_std=discrepancy)
    start, worlds = PointEstimate(SPACE.nominal, np.full(len(SPACE), 0.05)), list[np.ndarray]()

    def film(parameters: np.ndarray, latency_steps: int) -> Observed:
        worlds.append(parameters)
        return observe_nothing(parameters, latency_steps)

    def find(begun: np.ndarray) -> FitResult:
        off = usual.std * rng.normal(size=len(SPACE))
        return replace(usual, parameters=SPACE.from_unit(SPACE.to_unit(worlds[-1]) + off))

    for _ in range(300):
        seen = 0.5 + discrepancy * rng.normal(size=len(SPACE))
        film(SPACE.from_unit(seen), 0)
        fit = find(start.parameters)
        made = run_bootstrap(FakeReplayFit(find), film, fit, start, 5, rng)
        found = calibrated(fit, made, SPACE)
        error = SPACE.to_unit(found.parameters) - 0.5
        held.append(np.abs(error)[MOVING] < 1.645 * found.std[MOVING])
    assert 0.88 < np.mean(held) < 0.95


def test_a_cameras_error_common_to_all_colours_is_not_multiplied_by_how_surely_each_is_seen():
    """Fits that see a colour to .001 or to .01 are both off by what the camera does."""
    std = np.where(np.arange(len(SPACE)) % 2, 0.001, 0.01)
    rng = np.random.default_rng(0)
    discrepancy = ObservationModel.of_reality().discrepancy_std(SPACE.is_appearance)

    def find(start: np.ndarray) -> FitResult:
        off = np.where(np.isin(np.arange(len(SPACE)), APPEARANCE), 0.05 * rng.normal(), 0.0)
        truth = SPACE.to_unit(start)  # it starts there, below
        found = SPACE.from_unit(truth + off)
        return replace(a_fit(), parameters=found, std=std, discrepancy_std=discrepancy)

    real = replace(a_fit(), std=std, discrepancy_std=discrepancy)
    exact = PointEstimate(SPACE.nominal, NOTHING)
    made = run_bootstrap(FakeReplayFit(find), observe_nothing, real, exact, 6, rng)
    wide = calibrated(real, made, SPACE).std[APPEARANCE]
    assert 0.03 < wide.min() <= wide.max() < 0.12


def test_colours_that_are_known_say_nothing_of_how_well_others_are_found():
    rng = np.random.default_rng(0)
    known = APPEARANCE[:3]
    starts = []

    def find(start: np.ndarray) -> FitResult:
        starts.append(start[known])
        off = np.where(np.isin(np.arange(len(SPACE)), APPEARANCE[3:]), 0.03 * rng.normal(), 0.0)
        found = SPACE.from_unit(SPACE.to_unit(start) + off)
        found[known] = SPACE.nominal[known]
        return replace(a_fit(), parameters=found, known=known)

    real = replace(a_fit(), known=known)
    made = run_bootstrap(
        FakeReplayFit(find), observe_nothing, real, PointEstimate(SPACE.nominal, NOTHING), 6, rng
    )
    np.testing.assert_array_equal(made.errors[:, known], 0)
    some = replace(made, errors=np.delete(made.errors, known, 1), unfitted=np.zeros(0, int))
    some = replace(some, is_moving=np.delete(made.is_moving, known))
    np.testing.assert_allclose(np.delete(made.inflation(), known), some.inflation())


def test_what_is_held_says_nothing_of_how_well_the_rest_is_found():
    """Readings told it: a refit leaves it where it began, as far off as readings may be."""
    errors = 4.0 * np.random.default_rng(0).normal(size=(6, len(SPACE)))
    held = MOVING[:-1]
    errors[:, held] = 0.1
    usual = refits_of(errors)
    told = replace(usual, unfitted=held)
    alone = replace(
        usual, errors=np.delete(errors, held, 1), is_moving=np.delete(a_fit().is_moving, held)
    )
    last = MOVING[-1]
    assert told.inflation()[last] == pytest.approx(alone.inflation()[last - len(held)])
    assert told.inflation()[last] > 1.1 * usual.inflation()[last]
    assert replace(a_fit(), held=held, known=APPEARANCE[:1]).unfitted.tolist() == sorted(
        [*held, APPEARANCE[0]]
    )


def test_misfit_that_cannot_be_told_makes_everything_that_moves_unsure():
    refits = refits_of(np.zeros((2, len(SPACE))))
    lost = a_fit(motion=float("nan"))
    assert np.isinf(calibrated(lost, refits, SPACE).std[MOVING]).all()
    told = held_out_misfit(lost, refits)
    assert told["passed"] is False
    assert told["sensors"]["keypoints"]["distance"] is None
    assert np.isfinite(calibrated(lost, refits, SPACE).std[APPEARANCE]).all()
    nowhere = replace(refits, misfits=[lost.misfit] * 2)
    for known in (nowhere, replace(refits, misfits=[])):  # nothing to compare with
        assert np.isfinite(calibrated(lost, known, SPACE).std).all()
        assert not any("No setting" in warning for warning in model_checks(lost, known))
        assert held_out_misfit(lost, known)["passed"] is None
    one_lost = replace(refits, misfits=[lost.misfit, a_fit().misfit])
    assert model_checks(a_fit(motion=0.9), one_lost), "a refit that was lost silences nothing"


def test_a_single_refit_is_said_to_be_one():
    (warning,) = model_checks(a_fit(), refits_of(np.zeros((1, len(SPACE)))))
    assert "single known world" in warning
    assert model_checks(a_fit(), refits_of(np.zeros((2, len(SPACE))))) == []


def test_model_checks_warn_of_misfit():
    refits = refits_of(np.zeros((8, len(SPACE))))
    assert model_checks(a_fit(), refits) == []
    (warning,) = model_checks(a_fit(motion=0.9), refits)
    assert "they are 0.9 px apart (keypoints), 3.0 times" in warning
    (warning,) = model_checks(a_fit(motion=float("nan")), refits)
    assert "nothing that moves is found for sure" in warning


@pytest.mark.parametrize(
    ("seen", "read", "is_misshapen", "where"),
    [
        (0.3, 0.01, False, "nothing"),
        (0.9, 0.01, False, "film"),
        (0.9, 0.01, True, "model"),
        (0.9, 0.09, False, "model"),
        (0.3, 0.09, False, "model"),
    ],
)
def test_what_only_cameras_see_may_be_the_films_fault(seen, read, is_misshapen, where):
    def with_readings(motion: float, angle: float) -> FitResult:
        return replace(a_fit(), sensors=(KEYPOINTS, ANGLE), misfit=a_misfit(motion, angle))

    known = [with_readings(0.3, 0.01).misfit] * 8
    refits = replace(refits_of(np.zeros((8, len(SPACE)))), misfits=known)
    beside = (Beside("keypoints", 4.3, 1.2, 0.01, -0.02),) * is_misshapen
    fit = replace(with_readings(seen, read), beside=beside)
    assert what_is_unexplained(fit, refits) == where


def test_pairs_of_any_kind_are_told_where_their_errors_go_together():
    assert correlated_pairs(a_fit().correlation, SPACE) == {"pole_mass, actuator_gain": 0.9}
    of_red = correlated("body_r", "ground_r", -0.7)
    assert correlated_pairs(of_red, SPACE) == {"body_r, ground_r": -0.7}
    of_two_channels = correlated("body_r", "ground_g", 0.9)
    assert correlated_pairs(of_two_channels, SPACE) == {}
    assert correlated_pairs(correlated("body_r", "ground_r", -0.5), SPACE) == {}


def test_correlations_are_those_of_the_intervals_once_refits_have_judged_them():
    """What no fit can see goes with nothing: of twice the variance, half the correlation."""
    known = refits_of(np.zeros((8, len(SPACE))))
    factor = known.inflation()[0]
    for worse in (1.0, 3.0):  # the real fit explains less than refits do: its own part grows
        unseen = replace(
            a_fit(motion=0.3 * worse),
            discrepancy_std=np.where(a_fit().is_moving, 0.01 * factor, 0.0),
        )
        found = calibrated(unseen, known, SPACE)
        expected = 0.9 * worse**2 / (worse**2 + 1)
        assert found.correlation[0, 1] == pytest.approx(expected)
    assert calibrated(a_fit(), known, SPACE).correlation[0, 1] == pytest.approx(0.9)


def test_pictures_as_late_as_can_be_fitted_make_all_doubtful():
    first = Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    late = replace(a_fit(), late_s={"pictures": (0.0375, 0.0001)}, is_too_late=True)
    known = refits_of(np.zeros((8, len(SPACE))))
    found, _ = conclude(curves, late, known, first, first)
    assert "identified" not in found.verdict
    (warning,) = delay_warnings(late.late_s, 0, 0.05)
    assert "Pictures come 38 ms late, the most that is fitted" in warning
    (warning,) = delay_warnings({"readings": (-0.0375, 0.0001)}, 0, 0.05)
    assert "Readings come 38 ms early" in warning
    assert "move the actions up by a row" in warning  # there is no negative latency
    assert "latency_s" not in warning
    assert [is_too_late(steps) for steps in (0.6, 0.72, -0.75)] == [False, True, True]


def test_pictures_that_are_all_alike_beside_the_simulation_are_told():
    known = refits_of(np.zeros((8, len(SPACE))))
    right = replace(a_fit(), beside=(Beside("keypoints", 1.4, 0.3, 0.2, 0.1),))
    assert model_checks(right, known) == []
    off = replace(a_fit(), beside=(*right.beside, Beside("keypoints", 4.3, 1.2, 0.5, -1.03)))
    (warning,) = model_checks(off, known)
    assert "seen 1.2 px beside where it is simulated" in warning
    assert "(in the mean 0.5 px right and 1.0 px up)" in warning
    apart = replace(a_fit(), beside=(Beside("keypoints", 4.3, 1.2, 0.01, -0.02),))
    (warning,) = model_checks(apart, known)
    assert "in all pictures alike, and its parts to different sides" in warning


def test_parts_beside_to_different_sides_leave_no_motion_identified():
    """As before a link that is too long, which a mass made up for; a camera aside moves all."""
    known, first = refits_of(np.zeros((8, len(SPACE)))), Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    for right, verdict in ((0.3, "weak"), (1.0, "identified")):
        fit = replace(a_fit(), beside=(Beside("keypoints", 4.3, 1.2, right, 0.02),))
        found, _ = conclude(curves, fit, known, first, first)
        assert {found.verdict[i] for i in MOVING} == {verdict}
        assert {found.verdict[i] for i in APPEARANCE} == {"identified"}


def test_how_far_beside_pictures_are_is_a_mean_by_how_well_each_keypoint_is_known():
    noise, places = np.ones(2), np.zeros((1, 2, 2, 2))
    std = np.array([[0.1, 0.2], [0.2, 0.0]])  # the last one is not known to err
    tracks = KeypointTracks(places, np.ones((1, 2, 2)), noise, (64, 64), common_px=std)
    found = np.array([0.4, -0.4, 0.2])  # px, of the three that may err
    (its,) = beside(AllEvidence((tracks,)), found / std.ravel()[:3] * COMMON_STD)
    assert its.stds == pytest.approx(np.sqrt((4**2 + 2**2 + 1**2) / 3))
    assert its.px == pytest.approx(np.sqrt((0.4**2 + 0.4**2 + 0.2**2) / 2))
    assert its.right == pytest.approx((0.4 / 0.1**2 + 0.2 / 0.2**2) / (0.1**-2 + 0.2**-2))
    assert its.down == pytest.approx(-0.4)


def test_a_known_colour_that_makes_no_camera_leaves_colours_at_most_weak():
    """A glossy column declared as known: its shades say gamma 1.22, and all colours were wrong."""
    usual, gains = ImageNoise(), np.full(3, np.log(0.6))  # a gain may be any
    camera = CameraResponse(np.append(gains, [np.log(1.22), -0.019]))
    assert not camera.is_usual(usual)
    assert CameraResponse(np.append(gains, [np.log(1.1), -0.019])).is_usual(usual)
    assert not CameraResponse(np.append(gains, [0.0, 0.04])).is_usual(usual)
    other = CameraResponse(np.zeros(5))
    assert Photometry(usual, np.zeros(1)).unusual([other, camera]) is camera
    assert Photometry(usual, np.zeros(1)).unusual([other]) is None
    its = replace(a_fit(), responses=[other, camera], unusual_camera=camera)
    known = refits_of(np.zeros((8, len(SPACE))))
    (warning,) = model_checks(its, known)
    assert "a gamma of 1.22 and an offset of -5 of 255 levels" in warning
    first = Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    for fit, colours in ((a_fit(), "identified"), (its, "weak")):
        found, _ = conclude(curves, fit, known, first, first)
        assert {found.verdict[i] for i in APPEARANCE} == {colours}
        assert {found.verdict[i] for i in MOVING} == {"identified"}


def test_what_ends_at_a_bound_is_told_but_nothing_lies_beyond_zero_or_a_colour():
    unit = np.full(len(SPACE), 0.5)
    everything = np.ones(len(SPACE), bool)
    assert bound_warnings(SPACE, unit, everything) == {}
    unit[:] = 1.0
    told = bound_warnings(SPACE, unit, everything)
    assert list(told) == [SPACE.names[i] for i in MOVING]
    assert "pole_mass ended at a bound of its range" in told["pole_mass"]
    assert bound_warnings(SPACE, unit, ~everything) == {}
    friction = replace(SPACE.parameters[0], name="friction", low=0.0, scale="linear", nominal=0.1)
    assert bound_warnings(ParameterSpace([friction]), np.zeros(1), np.ones(1, bool)) == {}
    # A force may be reversed, and a thing may stand on the other side
    gain = replace(SPACE.parameters[1], name="gain", low=0.0, scale="linear", nominal=0.1)
    assert gain.field == "actuator_gainprm"
    assert list(bound_warnings(ParameterSpace([gain]), np.zeros(1), np.ones(1, bool))) == ["gain"]


def test_a_camera_at_a_bound_of_its_pose_needs_another_key():
    """A camera_pose of a tuning file has neither low nor high."""
    space = ParameterSpace(camera_pose("camera", "front", (0.0, -1.0, 0.5), within_m=0.05))
    told = bound_warnings(space, np.ones(6), np.ones(6, bool))
    for names, key in (("xyz", "within_m"), (("pitch", "yaw", "roll"), "within_rad")):
        for name in names:
            assert told[f"camera_{name}"].endswith(f"give it a wider {key} to see")


@pytest.mark.parametrize(("of_readings", "said"), [(None, "31 ms"), (2, "131 ms")])
def test_a_delay_in_pictures_is_told_once_with_what_readings_found_of_it(of_readings, said):
    """Actions were shifted by that before the fit to pictures."""
    by_readings = None
    if of_readings is not None:
        by_readings = SimpleNamespace(latency_steps=of_readings, combined_with=lambda its, _: its)
    first = Distribution.first(SPACE, SPACE.nominal)
    flat = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    learned = SimpleNamespace(prob_higher=flat, searched=first)
    facts: dict[str, Any] = {
        "context": SimpleNamespace(simulator=SimpleNamespace(step_s=0.05), first=first),
        "fitting": SimpleNamespace(learned=learned),
        "by_readings": by_readings,
        "earlier": None,
    }
    judging = Judging(**facts)
    late = replace(a_fit(latency_steps=1), late_s={"pictures": (-0.019, 0.003)})
    estimate, _ = judging._conclude(late, refits_of(np.zeros((3, len(SPACE)))))
    assert estimate.latency_steps == 1
    assert estimate.warnings == [
        f"What an action does shows in pictures {said} later than the recordings say (± 3 ms); "
        "the estimates allow for it."
    ]


@pytest.mark.parametrize(("motion", "at"), [(0.3, 0.5), (9.0, 0.5), (0.3, 0.0)])
def test_other_actions_are_tried_where_the_motion_is_not_explained_or_at_a_bound(motion, at):
    """As of a motor that is reversed, and that the best fit switches off."""
    first = Distribution.first(SPACE, SPACE.nominal)
    flat = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    unit = SPACE.to_unit(SPACE.nominal)
    unit[MOVING[-1]] = at
    fit = replace(a_fit(motion=motion, latency_steps=2), parameters=SPACE.from_unit(unit))
    known, tried = refits_of(np.zeros((3, len(SPACE)))), list[list[int]]()

    def misread_actions(observed: object, start: object, latencies: list[int]) -> list[str]:
        tried.append(latencies)
        return ["the motor pushes the other way"]

    replay_fit: Any = SimpleNamespace(misread_actions=misread_actions)
    fitting = SimpleNamespace(
        start=None,
        learned=SimpleNamespace(prob_higher=flat, searched=first),
        observed=lambda: "what was observed",
        fit=lambda *_: Fitted(fit, replay_fit, cast(Any, None), 1.0),
    )
    facts: dict[str, Any] = {
        "context": SimpleNamespace(
            simulator=SimpleNamespace(step_s=0.05, space=SPACE), first=first
        ),
        "fitting": fitting,
        "by_readings": None,
        "earlier": EarlierRounds(known),
    }
    judged = Judging(**facts).judge(RoundTime(Budget(), False, Budget()), NO_CALLBACKS)
    is_wrong = motion == 9.0 or at == 0.0
    assert tried == [[0, 2]] * is_wrong
    said, verdict = judged.estimate.warnings, judged.estimate.verdict
    assert (said[0] == "the motor pushes the other way") == is_wrong
    assert any("No setting of the parameters" in warning for warning in said) == (motion == 9.0)
    assert [verdict[i] == "identified" for i in MOVING] == [not is_wrong] * len(MOVING)


@pytest.mark.parametrize(
    ("fit_s", "earlier", "is_whole"), [(20.0, 0, True), (5.0, 0, False), (20.0, 1, False)]
)
def test_known_worlds_may_take_from_later_rounds_if_this_one_has_no_time_for_two(
    fit_s, earlier, is_whole
):
    """Of 30 s that are left of the round, and 200 s of all; unless an earlier round has some."""
    facts = dict.fromkeys(("context", "fitting", "by_readings"))
    known = EarlierRounds(refits_of(np.zeros((earlier, len(SPACE)))) if earlier else None)
    judging = Judging(**cast(Any, facts), earlier=known)
    part, whole = Budget(30.0), Budget(200.0)
    given = judging._for_known_worlds(fit_s, RoundTime(part, True, whole))
    assert given is (whole if is_whole else part)


def test_blocks_of_covariances_become_one_correlation():
    motion, pictures = np.array([[4.0, 1.0], [1.0, 1.0]]), np.array([[9.0]])
    blocks = (np.array([0, 2]), motion), (np.array([1]), pictures)
    expected = [[1, 0, 0.5, 0], [0, 1, 0, 0], [0.5, 0, 1, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(block_correlation(4, blocks), expected)
    known = (np.array([3]), np.array([[0.0]]))
    np.testing.assert_allclose(block_correlation(4, [*blocks, known]), expected)


def test_without_a_refit_nothing_is_called_identified_and_that_is_said():
    first = Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    judged, none = refits_of(np.zeros((3, len(SPACE)))), refits_of(np.zeros((0, len(SPACE))))
    sure, _ = conclude(curves, a_fit(), judged, first, first)
    assert sure.verdict == ["identified"] * len(SPACE)
    assert sure.warnings == []
    unsure, _ = conclude(curves, a_fit(), none, first, first)
    assert "identified" not in unsure.verdict
    (warning,) = unsure.warnings
    assert "no time to fit a known world" in warning
    lost, _ = conclude(curves, a_fit(motion=3.0), judged, first, first)
    assert "identified" not in lost.verdict
    assert any("trust no number" in warning for warning in lost.warnings)


def test_where_known_worlds_show_nothing_for_sure_nothing_is_called_identified():
    first = Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    known = refits_of(np.zeros((3, len(SPACE))))
    unseen = replace(known, misfits=[a_misfit(np.nan)] * 3)
    found, _ = conclude(curves, a_fit(motion=9.0), unseen, first, first)
    assert found.held_out["passed"] is None
    assert "identified" not in found.verdict
    assert any("nothing that moves is found for sure" in warning for warning in found.warnings)


def test_what_a_fit_leaves_at_a_bound_is_not_called_identified():
    first = Distribution.first(SPACE, SPACE.nominal)
    curves = normal_curves(np.full(len(SPACE), 0.5), np.full(len(SPACE), 0.01))
    known, mass = refits_of(np.zeros((3, len(SPACE)))), SPACE.index("pole_mass")
    at_bound = replace(a_fit(), parameters=SPACE.nominal.copy())
    at_bound.parameters[mass] = SPACE.high[mass]
    found, _ = conclude(curves, at_bound, known, first, first)
    others = np.arange(len(SPACE)) != mass
    assert found.verdict[mass] == "weak"
    assert (np.array(found.verdict)[others] == "identified").all()
    (warning,) = found.warnings
    assert warning.startswith("pole_mass ended at a bound of its range")


def concluded(space: ParameterSpace, unit_of_first: float) -> Estimate:
    """With a sharp fit of the pole's mass there, in coordinates of the first range."""
    first, mass = Distribution.first(space, space.nominal), space.index("pole_mass")
    curves = normal_curves(np.full(len(space), 0.5), np.full(len(space), 0.01))
    at = np.full(len(space), 0.5)
    at[mass] = unit_of_first
    parameters = np.where(np.arange(len(space)) == mass, first.from_range_unit(at), space.nominal)
    fit, known = replace(a_fit(), parameters=parameters), refits_of(np.zeros((3, len(space))))
    return conclude(curves, fit, known, first, first)[0]


@pytest.mark.parametrize("side", [-1, 1])
def test_what_a_fit_finds_beyond_a_rounds_reach_is_told_as_found_and_not_called_identified(side):
    """The first range is a factor of 3 up and down, its curves' grid one of 3^1.5."""
    near = replace(SPACE.parameters[0], low=0.1 * 3**-1.6, high=0.1 * 3**1.6)
    narrow, mass = ParameterSpace([near, *SPACE.parameters[1:]]), SPACE.index("pole_mass")
    assert mass == 0
    for space in (SPACE, narrow):
        found = concluded(space, 0.5 + 0.78 * side)
        bound = (space.high if side > 0 else space.low)[mass]
        assert found.mean[mass] == pytest.approx(0.1 * 3 ** (1.56 * side))
        assert (found.high if side > 0 else found.low)[mass] == bound
        assert found.verdict[mass] == "weak"
        (warning,) = found.warnings
        edge = "0.52" if side > 0 else "0.0192"
        assert warning.startswith(f"pole_mass ended beyond {edge}, the edge of what")
        assert f"up to the bound of {bound:.3g}," in warning
        drawn = Joint.of(found, space).draw(4000, np.random.default_rng(0))[:, mass]
        assert np.median(drawn) == pytest.approx(found.mean[mass], rel=0.02)
    within = concluded(SPACE, 0.5 + 0.6 * side)
    assert (within.verdict[mass], within.warnings) == ("identified", [])
    assert within.mean[mass] == pytest.approx(0.1 * 3 ** (1.2 * side), rel=1e-2)
    at_bound = concluded(SPACE, 0.5 + 2 * side)
    bound = (SPACE.high if side > 0 else SPACE.low)[mass]
    assert at_bound.mean[mass] == pytest.approx(bound)
    (warning,) = at_bound.warnings
    assert warning.startswith("pole_mass ended at a bound of its range")
