"""The joint posterior: marginals as their curves say, correlated as the fit's errors are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import spearmanr

from simtune.parameters import Parameter, ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.combinations import combinations
from simtune.tuning.estimate import Estimate, unsure
from simtune.tuning.joint import Joint
from simtune.tuning.range_update import read_curves
from simtune.tuning.survival_curves import candidate_grid, quantile
from simtune.tuning.truncated_normal import draw_beside, draw_in_box

SPACE = ParameterSpace(
    [
        Parameter(
            name="mass", field="body_mass", objects=("a",), nominal=1, low=0.01, high=100, unit="kg"
        ),
        Parameter(
            name="damping",
            field="dof_damping",
            objects=("a",),
            nominal=1,
            low=0.1,
            high=10,
            unit="N",
        ),
        Parameter(
            name="red",
            field="geom_rgba",
            objects=("a",),
            component=0,
            nominal=0.5,
            low=0,
            high=1,
            scale="linear",
            unit="1",
        ),
        Parameter(
            name="push",
            field="opt.gravity",
            component=0,
            nominal=0,
            low=-5,
            high=5,
            scale="linear",
            unit="1",
        ),
    ]
)
FIRST = Distribution.first(SPACE, SPACE.nominal)
GRID = candidate_grid()
CORRELATION = np.array(
    [[1, 0.9, 0, 0.3], [0.9, 1, 0, 0], [0, 0, 1, -0.6], [0.3, 0, -0.6, 1]], float
)


def normal_curves(mean, std) -> np.ndarray:
    """(N, C) on the grid, in coordinates of the range."""
    return ndtr((np.array(mean)[:, None] - GRID) / np.array(std)[:, None])


def joint_of(mean, std, correlation=CORRELATION) -> tuple[Joint, Estimate, np.ndarray]:
    curves = normal_curves(mean, std)
    estimate = read_curves(curves, FIRST, FIRST)
    estimate = replace(estimate, correlation=correlation)
    return Joint.of(estimate, SPACE), estimate, curves


@pytest.mark.parametrize("std", [0.0003, 0.002, 0.02, 0.15])  # of the range: fits are so sharp
def test_draws_have_the_marginals_of_the_curves(std):
    joint, estimate, curves = joint_of([0.4, 0.6, 0.5, 0.5], [std] * 4)
    draws = joint.draw(40_000, np.random.default_rng(0))
    in_range = FIRST.to_range_unit(draws)
    for share in (0.05, 0.25, 0.5, 0.75, 0.95):
        expected = quantile(curves, share)
        found = np.quantile(in_range, share, axis=0)
        np.testing.assert_allclose(found, expected, atol=0.05 * std)
    np.testing.assert_allclose(
        np.median(in_range, 0), FIRST.to_range_unit(estimate.mean), atol=0.05 * std
    )
    inside = (draws >= estimate.low) & (draws <= estimate.high)
    np.testing.assert_allclose(inside.mean(0), 0.9, atol=0.01)


def test_draws_have_the_rank_correlation_of_the_copula_whatever_the_marginals_are():
    joint, _, _ = joint_of([0.4, 0.6, 0.5, 0.5], [0.02, 0.2, 0.05, 0.002])
    draws = joint.draw(40_000, np.random.default_rng(1))
    expected = 6 / np.pi * np.arcsin(CORRELATION / 2)
    np.testing.assert_allclose(spearmanr(draws).statistic, expected, atol=0.015)


def test_the_sign_says_whether_two_rise_together():
    """A ratio that is known and a product that is not, in numbers rather than in ranks."""
    joint, _, _ = joint_of([0.5] * 4, [0.1] * 4, _pair(0.99))
    mass, damping = joint.draw(5000, np.random.default_rng(2))[:, :2].T
    assert np.std(np.log(mass / damping)) < 0.2 * np.std(np.log(mass * damping))
    opposed, _, _ = joint_of([0.5] * 4, [0.1] * 4, _pair(-0.99))
    mass, damping = opposed.draw(5000, np.random.default_rng(2))[:, :2].T
    assert np.std(np.log(mass * damping)) < 0.2 * np.std(np.log(mass / damping))


def _pair(value: float) -> np.ndarray:
    correlation = np.eye(4)
    correlation[0, 1] = correlation[1, 0] = value
    return correlation


def test_draws_of_a_truth_at_a_bound_or_beyond_the_grid_stay_within_the_bounds():
    joint, estimate, _ = joint_of([0.5, 1.4, 1.0, 0.0], [0.05, 0.05, 0.1, 0.1])
    draws = joint.draw(5000, np.random.default_rng(3))
    np.testing.assert_array_equal(draws, SPACE.clip(draws))
    # Beyond the grid's end, 3^1.5, anything up to the bound is possible.
    beyond = draws[:, 1] > 3**1.5
    assert beyond.mean() > 0.98
    assert np.quantile(draws[:, 1], 0.99) > 0.9 * estimate.high[1] == 9
    assert (draws[:, 2] == 1).mean() == pytest.approx(0.5, abs=0.03)  # at most all red


def test_a_curve_that_tells_nothing_leaves_all_of_the_bounds():
    joint, _, _ = joint_of([0.5, 0.5, 0.5, 0.5], [50.0, 0.05, np.inf, 0.05])
    unit = SPACE.to_unit(joint.draw(20_000, np.random.default_rng(4)))
    for i in (0, 2):
        np.testing.assert_allclose(
            np.quantile(unit[:, i], (0.1, 0.5, 0.9)), (0.1, 0.5, 0.9), atol=0.015
        )


@pytest.mark.parametrize(
    ("mean", "ends"), [(-0.5, (-0.6, -0.4)), (0.0, (-0.1, 0.1)), (0.95, (0.85, 1))]
)
def test_a_range_of_what_may_be_negative_is_a_share_of_its_bounds(mean, ends):
    yaw = Parameter(
        name="yaw", field="opt.o", nominal=0, low=-1, high=1, unit="rad", scale="linear"
    )
    around = Distribution.proportional(ParameterSpace([yaw]), np.array([mean]), 0.1)
    assert (around.low[0], around.high[0]) == pytest.approx(ends)


def test_without_curves_draws_are_uniform_in_the_range_and_independent():
    searched = Distribution.proportional(SPACE, np.array([2.0, 1.0, 0.5, 2.0]), 0.5)
    joint = Joint.of(unsure(searched, "weak"), SPACE)
    draws = joint.draw(20_000, np.random.default_rng(5))
    assert (draws >= searched.low - 1e-9).all()
    assert (draws <= searched.high + 1e-9).all()
    for share in (0.1, 0.5, 0.9):
        of_range = (np.quantile(draws, share, axis=0) - searched.low) / (
            searched.high - searched.low
        )
        np.testing.assert_allclose(of_range, share, atol=0.01)
    assert np.abs(np.corrcoef(draws.T) - np.eye(4)).max() < 0.03


def test_a_singular_correlation_can_be_drawn_from():
    joint, _, _ = joint_of([0.5] * 4, [0.1] * 4, np.ones((4, 4)))
    unit = SPACE.to_unit(joint.draw(100, np.random.default_rng(6)))
    assert np.ptp(FIRST.to_range_unit(SPACE.from_unit(unit)), axis=1).max() < 1e-3


def test_covariance_is_that_of_the_normal_errors_that_the_curves_are_of():
    std = np.array([0.02, 0.03, 0.04, 0.05])
    joint, _, _ = joint_of([0.4, 0.6, 0.5, 0.5], std)
    mean, covariance = joint.mean_and_covariance()
    width = SPACE.to_unit(FIRST.high) - SPACE.to_unit(FIRST.low)
    np.testing.assert_allclose(
        covariance, CORRELATION * np.outer(std * width, std * width), rtol=0.01
    )
    at = FIRST.from_range_unit(np.array([0.4, 0.6, 0.5, 0.5]))
    np.testing.assert_allclose(mean, SPACE.to_unit(at), atol=1e-4)


# --- what two show together -----------------------------------------------------------------


def combined(mean, std, told: dict[str, float], correlation: float, space=SPACE):
    """The combinations of normal errors in range coordinates, of which two are correlated."""
    (names,) = told
    i, j = (SPACE.index(name) for name in names.split(", "))
    matrix = np.eye(4)
    matrix[i, j] = matrix[j, i] = correlation
    joint, estimate, _ = joint_of(mean, std, matrix)
    draws = joint.draw(40_000, np.random.default_rng(7))
    return combinations(replace(estimate, correlations=told), space, draws)


def test_the_interval_of_a_ratio_by_hand():
    """log a − log b of errors σ and r is normal, with σ √(2 (1 − r))."""
    (found,) = combined([0.5] * 4, [0.05] * 4, {"mass, damping": 0.95}, 0.95)
    assert (found.a, found.b, found.kind, found.weight) == ("mass", "damping", "ratio", 1)
    half = 1.645 * 0.05 * np.log(9) * np.sqrt(2 * 0.05)
    np.testing.assert_allclose(
        np.log([found.low, found.mean, found.high]), [-half, 0, half], atol=0.03 * half + 1e-3
    )


def test_the_interval_of_a_product_with_a_power():
    std = [0.1, 0.05, 0.05, 0.05]  # log mass is twice as unsure: mass · damping² is known
    (found,) = combined([0.5] * 4, std, {"mass, damping": -0.98}, -0.98)
    assert (found.kind, found.weight) == ("product", 2)
    half = 1.645 * 0.1 * np.log(9) * np.sqrt(2 * 0.02)
    np.testing.assert_allclose(np.log([found.low, found.high]), [-half, half], rtol=0.04)


def test_what_may_be_negative_has_a_difference_or_a_sum_on_linear_scales_only():
    middle = [0.5] * 4
    (found,) = combined(middle, [0.05] * 4, {"red, push": 0.95}, 0.95)
    assert (found.kind, found.weight) == ("difference", 0.1)  # of widths 1 and 10
    half = 1.645 * 0.05 * np.sqrt(2 * 0.05)
    np.testing.assert_allclose([found.low, found.high], [0.5 - half, 0.5 + half], atol=0.02 * half)
    (found,) = combined(middle, [0.05] * 4, {"red, push": -0.95}, -0.95)
    assert found.kind == "sum"
    assert combined(middle, [0.05] * 4, {"mass, push": 0.95}, 0.95) == []
    metres = ParameterSpace([*SPACE.parameters[:3], replace(SPACE["push"], unit="m")])
    assert combined(middle, [0.05] * 4, {"red, push": 0.95}, 0.95, metres) == []


def test_no_power_is_told_of_a_place_nor_one_that_nobody_can_use():
    middle = [0.5] * 4
    height = replace(SPACE["push"], low=1, high=3, nominal=2, unit="m")  # never negative
    space = ParameterSpace([*SPACE.parameters[:3], height])
    assert combined(middle, [0.05] * 4, {"mass, push": -0.9}, -0.9, space) == []
    std = [0.3, 0.02, 0.05, 0.05]  # mass · damping^15
    assert combined(middle, std, {"mass, damping": -0.9}, -0.9) == []


def test_of_two_colours_the_plain_ratio_is_told_however_unsure_either_is():
    colours = [
        replace(SPACE["red"], name=f"{name}_r", objects=(name,), component=0) for name in "ab"
    ]
    space = ParameterSpace(colours)
    draws = np.array([[0.4, 0.2], [0.6, 0.3], [0.5, 0.25]])  # one light on both
    verdict = ["weak", "weak"]
    estimate = Estimate(draws[2], np.array([0.4, 0.24]), np.array([0.6, 0.26]), verdict)
    estimate = replace(estimate, correlations={"a_r, b_r": 0.9})
    (found,) = combinations(estimate, space, draws)
    assert (found.kind, found.weight) == ("ratio", 1)
    np.testing.assert_allclose([found.low, found.mean, found.high], 2)


def test_a_delay_of_zero_is_drawn_from_a_part_of_its_range():
    delay = replace(SPACE.parameters[0], low=0.0, high=0.2, nominal=0.0, scale="linear")
    around = Distribution.proportional(ParameterSpace([delay]), np.zeros(1), 0.5)
    assert (around.low[0], around.high[0]) == (0, pytest.approx(0.01))


def test_what_only_a_ratio_tells_keeps_the_ratio_that_the_fit_found():
    """Both may be anywhere, but together: not in the ratio of the middles of their bounds."""
    mean, std = [0.2, 0.5, 0.5, 0.5], [2.0, 2.0, 0.05, 0.05]
    joint, estimate, _ = joint_of(mean, std, _pair(0.9999))
    assert estimate.verdict[:2] == ["not identifiable"] * 2
    draws = joint.draw(20_000, np.random.default_rng(6))
    np.testing.assert_array_equal(draws, SPACE.clip(draws))
    mass, damping = draws[:, :2].T
    found = FIRST.from_range_unit(np.array(mean))
    spread = np.log(FIRST.high[0] / FIRST.low[0]) * 2.0 * np.sqrt(2 * (1 - 0.9999))
    ratio = np.log(mass / damping)
    assert np.median(ratio) == pytest.approx(np.log(found[0] / found[1]), abs=0.3 * spread)
    assert np.std(ratio) == pytest.approx(spread, rel=0.05)
    assert np.log(damping.max() / damping.min()) > 0.95 * np.log(10 / 0.1)  # all of its bounds


@pytest.mark.parametrize("std", [0.05, 2.0])  # a curve of its own, or normal within the bounds
def test_fewer_and_more_draws_begin_alike(std):
    joint = joint_of([0.5] * 4, [std, std, 0.05, 0.05], _pair(0.9))[0]
    few, many = (joint.draw(num, np.random.default_rng(9)) for num in (3, 4003))
    assert few.shape == (3, 4)
    assert many.shape == (4003, 4)
    np.testing.assert_array_equal(many[:3], few)
    assert len(np.unique(many, axis=0)) == 4003


def test_draws_in_a_box_are_those_that_rejection_leaves():
    rng, mean = np.random.default_rng(7), np.array([0.2, 0.9, 0.5])
    root = np.array([[0.5, 0, 0], [0.4, 0.2, 0], [-0.1, 0.1, 0.3]])
    drawn = draw_in_box(mean, root @ root.T, 40_000, rng)
    tried = mean + rng.normal(size=(400_000, 3)) @ root.T
    kept = tried[((tried >= 0) & (tried <= 1)).all(1)]
    np.testing.assert_allclose(drawn.mean(0), kept.mean(0), atol=0.01)
    np.testing.assert_allclose(np.cov(drawn.T), np.cov(kept.T), atol=0.003)


def test_the_others_go_along_with_what_lies_in_the_box():
    rng, is_known = np.random.default_rng(8), np.array([False, True, False])
    correlation = np.array([[1, 0.8, 0.3], [0.8, 1, 0], [0.3, 0, 1]])
    known = rng.uniform(1, 2, (40_000, 1))  # far from a normal one
    drawn = draw_beside(known, is_known, correlation, rng)
    np.testing.assert_array_equal(drawn[:, 1:2], known)
    left = drawn[:, 0] - 0.8 * known[:, 0]
    assert left.mean() == pytest.approx(0, abs=0.01)
    assert left.std() == pytest.approx(0.6, rel=0.02)
    assert np.cov(left, drawn[:, 2])[0, 1] == pytest.approx(0.3, abs=0.01)
