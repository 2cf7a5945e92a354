"""Estimates of many experiments combined: sums by hand."""

import numpy as np
import pytest

from simtune.fit.combine import COMMON_STD, FIRST_VARIANCE, Combined, combine
from simtune.normal import STDS_90
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.tasks import load_task
from simtune.tuning.range_update import read_curves
from simtune.tuning.survival_curves import candidate_grid, with_fit

MIDDLE = np.full(7, 0.5)  # of unit coordinates


def test_experiments_are_weighted_by_their_variance_plus_that_between_them():
    information = np.array([4.0, 1.0])  # variances ¼ and 1
    estimate = np.array([0.02, -0.01])
    combined = combine(
        information[:, None, None], -(information * estimate)[:, None], 0.5, np.ones(2)
    )
    weight = 1 / (1 / information + 0.5)
    best = -np.linalg.solve(combined.information, combined.slope)
    np.testing.assert_allclose(best, (weight @ estimate) / weight.sum(), rtol=1e-2)
    assert combined.covariance.shape == (1, 1)


def test_one_overconfident_experiment_does_not_outweigh_the_others():
    information = np.full(30, 1e4)
    estimate = np.random.default_rng(0).normal(0, 0.01, 30)
    information[0], estimate[0] = 1e12, 0.5
    combined = combine(
        information[:, None, None],
        -(information * estimate)[:, None],
        FIRST_VARIANCE,
        np.ones(30),
    )
    assert abs(combined.step(MIDDLE[:1], 1.0)[0] - estimate[1:].mean()) < 0.005
    assert 0.001 < np.sqrt(combined.covariance[0, 0]) < 0.01


def test_experiments_that_know_one_combination_precisely_give_finite_covariance():
    known = np.array([1.0, 2.0, 0, 0, 0, 0, 0])  # of seven parameters
    information = np.repeat(1e8 * np.outer(known, known)[None], 6, 0)
    slope = 1e4 * known * np.random.default_rng(0).normal(size=(6, 1))
    combined = combine(information, slope, FIRST_VARIANCE, np.ones(6))
    assert np.abs(combined.step(MIDDLE[:7], 1.0)).max() < 1e-3
    assert np.isfinite(combined.covariance).all()


def test_errors_that_all_have_in_common_do_not_average_out():
    """Independent: generalised least squares, where the common error is part of the covariance."""
    rng = np.random.default_rng(0)
    num, noise, away = 200, 0.05, 2 * COMMON_STD
    by_parameter, by_common = rng.normal(1, 0.3, num), rng.normal(1, 0.1, num)
    seen = 0.01 * by_parameter + away * by_common + noise * rng.normal(size=num)
    design = np.stack([by_parameter, by_common], 1) / noise
    covariance = noise**2 * np.eye(num) + COMMON_STD**2 * np.outer(by_common, by_common)
    weight = np.linalg.solve(covariance, by_parameter)
    best, variance = weight @ seen / (weight @ by_parameter), 1 / (weight @ by_parameter)

    information = design[:, :, None] * design[:, None]
    point = np.zeros(2)  # a parameter and a common error
    for _ in range(30):
        slope = design * (design @ point - seen / noise)[:, None]
        combined = combine(information, slope, 1e-12, np.ones(num), point[1:])
        point += np.linalg.solve(combined.information, -combined.slope)
    assert point[0] == pytest.approx(best, abs=0.2 * np.sqrt(variance))
    # A Student's weights make normal experiments seem a little surer.
    assert variance / 3 < combined.covariance[0, 0] < 1.5 * variance
    alone = combine(information[:, :1, :1], slope[:, :1], 1e-12, np.ones(num))
    assert alone.covariance[0, 0] < variance / 10, "as if they were independent"


def test_scatter_allows_for_the_common_errors_that_were_found_from_it():
    """What is claimed is how far estimates are off, also of few experiments with many errors."""
    rng, num, num_common = np.random.default_rng(0), 20, 10
    off, claimed = [], []
    for _ in range(200):
        by_parameter = rng.normal(1, 0.3, (num, 1))
        design = 30 * np.concatenate([by_parameter, rng.normal(size=(num, num_common))], 1)
        noise, point = rng.normal(size=num), np.zeros(1 + num_common)
        information = design[:, :, None] * design[:, None]
        for _ in range(10):
            slope = design * (design @ point - noise)[:, None]
            combined = combine(information, slope, 1e-12, np.ones(num), point[1:])
            point += np.linalg.solve(combined.information, -combined.slope)
        off.append(point[0])
        claimed.append(combined.covariance[0, 0])
    assert np.sqrt(np.mean(claimed)) == pytest.approx(np.std(off), rel=0.2)


def test_single_experiment_is_no_surer_than_it_claims():
    claimed = 0.02**2
    covariance = combine(
        np.full((1, 1, 1), 1 / claimed), np.full((1, 1), 3.0), FIRST_VARIANCE, np.ones(1)
    ).covariance
    np.testing.assert_allclose(covariance, claimed + FIRST_VARIANCE, rtol=0.25)
    # Of many that agree better than they claim, their agreement counts.
    information, slope = np.full((60, 1, 1), 1 / claimed), np.full((60, 1), 1e-6)
    covariance = combine(information, slope, FIRST_VARIANCE, np.ones(60)).covariance
    assert covariance[0, 0] < 0.1 * claimed / 60


@pytest.mark.parametrize("num_parameters", [1, 2, 4])
@pytest.mark.parametrize("num", [20, 90])
def test_nine_of_ten_intervals_hold_however_many_parameters_and_experiments(num_parameters, num):
    """Exactly normal experiments, and the variance between them unknown."""
    rng, own, between, off = np.random.default_rng(0), 0.005, 0.02, []
    information = np.tile(np.eye(num_parameters) / own**2, (num, 1, 1))
    for _ in range(200):
        estimates = np.hypot(own, between) * rng.normal(size=(num, num_parameters))
        point, variance = np.zeros(num_parameters), FIRST_VARIANCE
        for _ in range(12):
            combined = combine(information, (point - estimates) / own**2, variance, np.ones(num))
            point = point - np.linalg.solve(combined.information, combined.slope)
            variance = combined.variance
        off.append(point / np.sqrt(np.diag(combined.covariance)))
    assert 0.86 <= np.mean(np.abs(off) < STDS_90) <= 0.95


@pytest.mark.parametrize("informative", [1, 2, 5])
def test_parameter_that_few_experiments_inform_about_claims_no_less_than_it_errs(informative):
    """Of 60, each of which errs by its own noise and by what differs between them."""
    rng, num, own, between = np.random.default_rng(0), 60, 0.01, 0.02
    information = np.zeros((num, 2, 2))
    information[:, 0, 0] = information[:informative, 1, 1] = own**-2
    off, claimed = [], []
    for _ in range(200):
        estimates = np.hypot(own, between) * rng.normal(size=(num, 2))
        slope = np.einsum("wpq,wq->wp", information, -estimates)
        combined = combine(information, slope, between**2, np.ones(num))
        off.append(combined.step(MIDDLE[:2], 1.0))
        claimed.append(np.diag(combined.covariance))
    std, usual = np.sqrt(np.mean(np.square(off), 0)), np.sqrt(np.median(claimed, 0))
    np.testing.assert_allclose(usual, std, rtol=0.35)


def test_prior_of_common_errors_counts_once():
    """A parameter and an offset of all experiments that act as one: the offset's prior is left."""
    for num in (1, 3, 60):
        information = 1e8 * np.ones((num, 2, 2))
        combined = combine(information, np.zeros((num, 2)), 1e-12, np.ones(num), np.zeros(1))
        assert np.sqrt(combined.covariance[0, 0]) == pytest.approx(COMMON_STD, rel=0.01)


def test_step_at_a_bound_holds_that_parameter_and_is_best_for_the_others():
    # Down the valley of x + y; the bound of x is in the way, so that y goes alone.
    information = np.full((2, 2), 1e6)
    combined = Combined(1e6 * np.array([0.02, 0.02]), information, np.eye(2), FIRST_VARIANCE)
    np.testing.assert_allclose(combined.step(np.array([0.0, 0.5]), 1.0), [0, -0.02], rtol=1e-3)
    np.testing.assert_allclose(combined.step(np.array([0.5, 0.5]), 1.0), [-0.01, -0.01], rtol=1e-3)
    # Too long a step keeps its direction.
    np.testing.assert_allclose(combined.step(np.array([0.5, 0.5]), 0.001), [-0.001] * 2, rtol=1e-3)


def test_parameter_without_information_stays_unknown():
    information = np.zeros((20, 2, 2))
    information[:, 0, 0] = 1e4  # of the first parameter only
    slope = np.zeros((20, 2))
    slope[:, 0] = np.random.default_rng(0).normal(0, 100, 20)
    combined = combine(information, slope, FIRST_VARIANCE, np.ones(20))
    std = np.sqrt(np.diag(combined.covariance))
    assert combined.step(MIDDLE[:2], 1.0)[1] == 0
    assert std[0] < 0.02
    assert std[1] > 0.9  # of the whole space, in unit coordinates
    space = ParameterSpace([p for p in load_task("cartpole").parameters if not p.is_appearance])
    first = Distribution.first(space, space.nominal)
    flat = np.tile((1 - candidate_grid()).clip(0, 1), (2, 1))
    in_range = std / (space.to_unit(first.high) - space.to_unit(first.low))
    curves = with_fit(flat, np.full(2, 0.5), in_range)
    estimate = read_curves(curves, first, first)
    assert estimate.verdict == ["identified", "not identifiable"]
    assert estimate.low[1] <= first.low[1]
    assert estimate.high[1] >= first.high[1]
