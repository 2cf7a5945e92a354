"""How Ξ moves: by hand, and what must hold whatever the curves say."""

import numpy as np
import pytest

from simtune.parameters import Parameter, ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.edges import doubted_at_edges, leads_beyond, out_of_reach
from simtune.tuning.range_update import (
    MARGIN,
    SMALLEST_SHARE,
    read_curves,
    update_range,
)
from simtune.tuning.survival_curves import (
    blurred,
    candidate_grid,
    normal_curves,
    quantile,
    shortest_interval,
    with_fit,
)
from simtune.verdicts import IDENTIFIED_SHARE, WEAK_SHARE

GRID = candidate_grid()


def a_parameter(name: str, low: float, high: float, scale: str = "linear") -> Parameter:
    nominal = (low * high) ** 0.5 if scale == "log" else (low + high) / 2
    return Parameter(
        name=name, field="opt.o", nominal=nominal, low=low, high=high, scale=scale, unit="1"
    )


SPACE = ParameterSpace([a_parameter("red", 0.0, 1.0), a_parameter("mass", 0.01, 100.0, "log")])
FIRST = Distribution.first(SPACE, np.array([0.5, 1.0]))  # red [0, 1], mass [1/3, 3]


def logistic(location, scale) -> np.ndarray:
    """(N, C) survival curves on the grid."""
    location, scale = np.atleast_1d(location)[:, None], np.atleast_1d(scale)[:, None]
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp((GRID - location) / scale))


def flat(num: int = 2) -> np.ndarray:
    """What nothing but the prior gives: uniform in the range."""
    return np.tile(np.clip(1 - GRID, 0, 1), (num, 1))


def narrowed_to(low, high) -> Distribution:
    low, high = np.array(low), np.array(high)
    return FIRST.with_interval(
        SPACE.from_unit((SPACE.to_unit(low) + SPACE.to_unit(high)) / 2), low, high
    )


def test_independent_errors_widen_a_curve_as_variances_add():
    """In the mass's range, [1/3, 3], .005 of its unit coordinate are .021."""
    std = np.array([0.0, 0.005])
    curves = blurred(normal_curves(np.array([0.4, 0.6]), np.array([0.02, 0.02])), std, FIRST)
    width = SPACE.to_unit(FIRST.high) - SPACE.to_unit(FIRST.low)
    expected = normal_curves(np.array([0.4, 0.6]), np.hypot(0.02, std / width))
    np.testing.assert_allclose(curves, expected, atol=1e-4)
    np.testing.assert_allclose(blurred(flat(), std, FIRST), flat(), atol=0.02)


def test_a_curve_at_the_edge_of_what_networks_saw_is_not_called_identified():
    curves = normal_curves(np.array([0.5, 1.02]), np.array([0.01, 0.01]))
    read = read_curves(curves, FIRST, FIRST)
    assert read.verdict == ["identified", "identified"]
    _, events = update_range(curves, FIRST, FIRST)
    doubted = doubted_at_edges(read, events)
    assert doubted.verdict == ["identified", "weak"]
    (warning,) = doubted.warnings
    assert "beyond the range that was searched of mass," in warning
    _, inside = update_range(normal_curves(np.full(2, 0.5), np.full(2, 0.01)), FIRST, FIRST)
    assert doubted_at_edges(read, inside) is read


def test_another_round_leads_beyond_what_a_fit_could_not_follow():
    """A fit at 1.2 is within the grid, and one at 1.4 is not; the bound of red is at 1."""
    for location, is_beyond in ((1.2, False), (1.4, True)):
        curves = with_fit(flat(), np.full(2, location), np.full(2, 0.01))
        np.testing.assert_array_equal(out_of_reach(curves, FIRST), [0, is_beyond])
        _, events = update_range(curves, FIRST, FIRST)
        assert leads_beyond(curves, FIRST, events, is_fitted=True) == is_beyond
        assert leads_beyond(curves, FIRST, events, is_fitted=False)
        assert not leads_beyond(curves, FIRST, [], is_fitted=False)
    below = with_fit(flat(), np.full(2, -0.4), np.full(2, 0.01))
    np.testing.assert_array_equal(out_of_reach(below, FIRST), [0, -1])


# --- quantiles ----------------------------------------------------------------------------


def test_quantiles_of_a_uniform_curve():
    for share in (0.05, 0.5, 0.9):
        np.testing.assert_allclose(quantile(flat(), share), share, atol=1.5e-3)


def test_quantiles_of_logistics():
    curves = logistic([0.65, 0.4], [0.025, 0.005])
    for share in (0.1, 0.5, 0.95):
        expected = [0.65, 0.4] + np.array([0.025, 0.005]) * np.log(share / (1 - share))
        np.testing.assert_allclose(quantile(curves, share), expected, atol=1.5e-3)


def test_quantile_of_a_curve_that_rises_again_is_the_first():
    curve = logistic(0.5, 0.05)[0]
    bumpy = curve.copy()
    bumpy[GRID > 0.65] = np.maximum(bumpy[GRID > 0.65], 0.2)  # it rises again
    bumpy[GRID > 1.0] = 0
    found = quantile(bumpy[None], 0.5)
    np.testing.assert_allclose(found, 0.5, atol=1e-6)


def test_quantiles_beyond_the_grid_are_its_ends():
    assert quantile(logistic(3.0, 0.05), 0.5) == GRID[-1]
    assert quantile(logistic(-2.0, 0.05), 0.5) == GRID[0]


def test_shortest_interval_of_a_symmetric_curve_has_equal_tails():
    low, high = shortest_interval(logistic(0.6, 0.025), 0.9)
    expected = 0.025 * np.log(0.95 / 0.05)
    np.testing.assert_allclose([low[0], high[0]], [0.6 - expected, 0.6 + expected], atol=0.01)


def test_shortest_interval_reaches_the_bound_at_which_the_truth_may_lie():
    exponential = np.clip(np.exp(-GRID / 0.1), 0, 1)[None]  # densest at the range's low end
    low, high = shortest_interval(exponential, 0.9)
    assert low[0] == pytest.approx(0, abs=0.005)
    assert high[0] == pytest.approx(0.1 * np.log(10), abs=0.015)


# --- reading curves -----------------------------------------------------------------------


def test_estimate_reads_curves_along_each_parameters_scale():
    estimate = read_curves(logistic([0.75, 1.0], 0.005), FIRST, FIRST)
    np.testing.assert_allclose(estimate.mean, [0.75, 3.0], rtol=1e-3)
    tail = 0.005 * np.log(19)
    np.testing.assert_allclose(estimate.low, [0.75 - tail, 3 * 9**-tail], rtol=5e-3)
    np.testing.assert_allclose(estimate.high, [0.75 + tail, 3 * 9**tail], rtol=5e-3)
    assert set(estimate.curves) == {"red", "mass"}
    for candidates, prob_higher in estimate.curves.values():
        assert candidates.shape == prob_higher.shape
        assert (np.diff(candidates) >= 0).all()
        assert (np.diff(prob_higher) <= 0).all()
    candidates, prob_higher = estimate.curves["mass"]
    assert np.interp(3.0, candidates, prob_higher) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("share", [0, 0.2, 0.5])  # of a step of the grid, by which it lies beside
@pytest.mark.parametrize("std", [2e-4, 2e-3])
def test_a_sharp_fit_is_read_as_it_is(std, share):
    mean = 0.75 + share * (GRID[1] - GRID[0]) * np.ones(2)
    estimate = read_curves(with_fit(flat(), mean, np.full(2, std)), FIRST, FIRST)
    found = [FIRST.to_range_unit(v)[0] for v in (estimate.low, estimate.mean, estimate.high)]
    # The posterior network's few percent lie beside it, and widen it.
    middle, width = found[1], found[2] - found[0]
    assert middle == pytest.approx(mean[0], abs=0.06 * std)
    assert (found[0] + found[2]) / 2 == pytest.approx(mean[0], abs=0.25 * std)
    assert 2 * 1.645 * std < width < 2.5 * 1.645 * std


def test_estimates_stay_within_the_bounds():
    for location in (-4.0, 5.0):
        estimate = read_curves(logistic([location, location], 0.05), FIRST, FIRST)
        for values in (estimate.mean, estimate.low, estimate.high):
            np.testing.assert_array_equal(values, SPACE.clip(values))


def test_interval_of_a_fit_beyond_the_grid_reaches_the_bound():
    # mass: the grid's end is 3^1.5 = 5.2, the bound 100.
    posterior_net, mean = flat(), np.array([0.5, 1.3])
    estimate = read_curves(
        with_fit(posterior_net, mean, np.array([0.005, 0.025])),
        FIRST,
        FIRST,
    )
    assert estimate.verdict == ["identified", "not identifiable"]
    assert estimate.low[1] <= 3**1.6 <= estimate.high[1] == 100
    below = read_curves(
        with_fit(posterior_net, 1 - mean, np.full(2, 0.025)),
        FIRST,
        FIRST,
    )
    assert below.low[1] == 0.01
    assert below.low[1] <= 3**-1.6 <= below.high[1]


def test_range_widens_to_a_fit_beyond_its_edge_though_the_posterior_network_is_flat():
    curves = with_fit(flat(), np.array([0.5, 1.15]), np.full(2, 0.01))
    moved, events = update_range(curves, FIRST, FIRST)
    assert moved.low[1] <= 3**1.3 <= moved.high[1]
    assert ("widened", "mass") in {(event.event, event.parameter) for event in events}
    assert update_range(flat(), FIRST, FIRST)[1] == [], "that alone is no reason"


def test_verdicts_go_by_the_interval_within_the_first_range():
    def verdicts(scale: float, distribution: Distribution = FIRST) -> list[str]:
        return read_curves(logistic([0.5, 0.5], scale), distribution, FIRST).verdict

    # The 90 % interval is 2·log(19)·scale = 5.9·scale, of a range that is 1 wide.
    assert verdicts(0.95 * IDENTIFIED_SHARE / 5.9) == ["identified"] * 2
    assert verdicts(1.05 * IDENTIFIED_SHARE / 5.9) == ["weak"] * 2
    assert verdicts(0.95 * WEAK_SHARE / 5.9) == ["weak"] * 2
    assert read_curves(flat(), FIRST, FIRST).verdict == ["not identifiable"] * 2
    # The same curve within a tenth of the first range is ten times as narrow.
    tenth = narrowed_to([0.45, 3**-0.1], [0.55, 3**0.1])
    assert verdicts(2.5 * IDENTIFIED_SHARE / 5.9, tenth) == ["identified"] * 2


# --- moves --------------------------------------------------------------------------------


def test_sharp_curve_narrows_the_range_around_its_median():
    moved, events = update_range(logistic([0.6, 0.35], 0.015), FIRST, FIRST)
    half = MARGIN * 0.015 * np.log(99)
    np.testing.assert_allclose(moved.mean, [0.6, 3**-0.3], rtol=1e-3)
    expected = 0.6 - half, 0.6 + half
    np.testing.assert_allclose([moved.low[0], moved.high[0]], expected, atol=3e-3)
    expected = 3 ** (-0.3 - 2 * half), 3 ** (-0.3 + 2 * half)
    np.testing.assert_allclose([moved.low[1], moved.high[1]], expected, rtol=1e-2)
    assert [(e.event, e.parameter) for e in events] == [("narrowed", "red"), ("narrowed", "mass")]
    for i, event in enumerate(events):
        assert (event.low, event.high) == (moved.low[i], moved.high[i])
        assert event.reason


def test_flat_curve_keeps_the_range():
    distribution = narrowed_to([0.2, 0.5], [0.6, 2.0])
    moved, events = update_range(flat(), distribution, FIRST)
    np.testing.assert_allclose(moved.low, distribution.low, rtol=1e-9)
    np.testing.assert_allclose(moved.high, distribution.high, rtol=1e-9)
    np.testing.assert_allclose(moved.mean, [0.4, 1.0], rtol=1e-6)
    assert events == []


@pytest.mark.parametrize("side", [-1, 1])
def test_truth_at_the_edge_widens_the_range_there(side):
    distribution = narrowed_to([0.4, 0.8], [0.6, 1.25])
    moved, events = update_range(logistic([0.5 + 0.485 * side] * 2, 0.025), distribution, FIRST)
    if side > 0:
        assert (moved.high > distribution.high).all()
        assert (moved.low > distribution.low).all()  # where it is not is ruled out still
    else:
        assert (moved.low < distribution.low).all()
        assert (moved.high < distribution.high).all()
    assert [e.event for e in events] == ["widened", "widened"]
    assert "beyond" in events[0].reason


@pytest.mark.parametrize("side", [-1, 1])
def test_ranges_reach_a_truth_far_beyond_the_edge(side):
    truth = np.array([0.5 + 0.4 * side, 1.0 * 4.0**side])
    distribution = narrowed_to([0.4, 0.8], [0.6, 1.25])
    for _ in range(6):
        location = distribution.to_range_unit(truth)
        distribution, _ = update_range(logistic(location, 0.015), distribution, FIRST)
    assert (distribution.low < truth).all()
    assert (truth < distribution.high).all()
    np.testing.assert_allclose(distribution.mean, truth, rtol=0.02)


def test_ranges_end_at_the_bounds():
    distribution = narrowed_to([0.7, 40.0], [1.0, 100.0])
    moved, events = update_range(logistic([1.15, 1.15], 0.01), distribution, FIRST)
    np.testing.assert_allclose(moved.high, SPACE.high)
    np.testing.assert_allclose(moved.mean, SPACE.high)
    assert (moved.low < SPACE.high).all()
    assert "widened" not in [e.event for e in events]  # there is nothing beyond


def share_of_first(distribution: Distribution) -> np.ndarray:
    return FIRST.to_range_unit(distribution.high) - FIRST.to_range_unit(distribution.low)


def test_no_range_gets_narrower_than_its_smallest_share():
    distribution = FIRST
    for _ in range(5):
        distribution, _ = update_range(logistic([0.5, 0.5], 5e-5), distribution, FIRST)
    np.testing.assert_allclose(share_of_first(distribution), SMALLEST_SHARE, rtol=1e-6)


def test_no_range_gets_narrower_than_its_smallest_share_at_an_edge_or_a_bound():
    for location in (-0.2, 0.0, 0.01, 0.99, 1.0, 1.2):
        distribution = FIRST
        for _ in range(3):
            distribution, _ = update_range(
                logistic([location, location], 5e-5), distribution, FIRST
            )
            assert (share_of_first(distribution) > SMALLEST_SHARE * 0.999).all(), location


def test_any_curves_leave_a_range_that_can_be_searched():
    rng = np.random.default_rng(0)
    for _ in range(12):
        distribution = FIRST
        for _ in range(6):
            weights = rng.dirichlet([0.5] * 3, 2)
            curves = sum(
                weights[:, k, None]
                * logistic(rng.normal(0.5, 0.75, 2), 10 ** rng.uniform(-4, 0, 2) / 2)
                for k in range(3)
            )
            estimate = read_curves(curves, distribution, FIRST)
            assert (estimate.low <= estimate.mean).all()
            assert (estimate.mean <= estimate.high).all()
            distribution, events = update_range(curves, distribution, FIRST)
            for values in (distribution.low, distribution.mean, distribution.high):
                np.testing.assert_array_equal(values, SPACE.clip(values))
            assert (share_of_first(distribution) > SMALLEST_SHARE * 0.999).all()
            assert (distribution.low <= distribution.mean).all()
            assert (distribution.mean <= distribution.high).all()
            assert {e.event for e in events} <= {"widened", "narrowed"}


def test_update_range_changes_none_of_its_arguments():
    curves = logistic([0.95, 0.6], 0.025)
    before = curves.copy()
    update_range(curves, FIRST, FIRST)
    np.testing.assert_array_equal(curves, before)
    np.testing.assert_array_equal(FIRST.mean, [0.5, 1.0])
