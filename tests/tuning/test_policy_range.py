"""Ξ_policy by hand: what is identified, and how well, decides how wide it is."""

import numpy as np
import pytest

from simtune.parameters import Parameter, ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate, unsure
from simtune.tuning.policy_range import policy_range
from simtune.verdicts import Verdict


def a_parameter(name: str, nominal: float, low: float, high: float) -> Parameter:
    return Parameter(
        name=name, field="opt.o", nominal=nominal, low=low, high=high, scale="linear", unit="1"
    )


SPACE = ParameterSpace([a_parameter("mass", 2.0, 0.5, 8.0), a_parameter("angle", 0.0, -1.0, 1.0)])
SEARCHED = Distribution.first(SPACE, np.array([2.0, 0.0]))


def range_of_mass(low: float, high: float, verdict: Verdict) -> list[float]:
    """Ends of Ξ_policy with --range-policy .1, if the mass is 2 in [low, high]."""
    found = np.array([2.0, 0.0]), np.array([low, -0.5]), np.array([high, 0.5])
    drawn = policy_range(SEARCHED, Estimate(*found, [verdict, "weak"]), 0.1)
    assert (drawn.low[1], drawn.high[1]) == (-0.1, 0.1), "the weak one's: a tenth of its bounds"
    worlds = drawn.sample(2000, np.random.default_rng(0))
    np.testing.assert_allclose(worlds.mean(0), (drawn.low + drawn.high) / 2, atol=0.01)
    return [drawn.low[0], drawn.high[0]]


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        pytest.param(1.95, 2.05, [1.9, 2.1], id="twice the interval"),
        pytest.param(1.999, 2.001, [1.96, 2.04], id="at least a fifth of the whole range"),
        pytest.param(1.5, 2.5, [1.8, 2.2], id="at most the whole range"),
        pytest.param(1.99, 2.06, [1.96, 2.12], id="each side has its own width"),
    ],
)
def test_an_identified_parameter_is_drawn_from_twice_its_interval(low, high, expected):
    np.testing.assert_allclose(range_of_mass(low, high, "identified"), expected)


@pytest.mark.parametrize("verdict", ["weak", "not identifiable"])
def test_any_other_is_drawn_from_the_whole_range_of_the_paper(verdict):
    np.testing.assert_allclose(range_of_mass(1.999, 2.001, verdict), [1.8, 2.2])


def test_an_oracle_has_no_range():
    drawn = policy_range(SEARCHED, unsure(SEARCHED, "not identifiable"), 0.0)
    np.testing.assert_array_equal(drawn.low, drawn.high)
    np.testing.assert_array_equal(drawn.low, [2.0, 0.0])
