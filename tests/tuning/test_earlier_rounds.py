"""What earlier rounds concluded, for a round without time for its own."""

import json
from dataclasses import replace

import numpy as np
import pytest

from simtune.errors import InputError
from simtune.fit import Refits
from simtune.fit.result import Misfit
from simtune.tuning.earlier_rounds import EarlierRounds
from simtune.tuning.estimate import Estimate


def refits(num: int) -> Refits:
    misfits = [Misfit((0.3, float("nan")), (0.004,))] * num
    errors = np.random.default_rng(num).normal(size=(num, 3))
    is_moving, usual = np.array([True, True, False]), np.full(3, 0.01)
    return Refits(errors, is_moving, misfits, usual, np.array([1]))


@pytest.mark.parametrize(
    ("before", "made", "judges"),
    [
        (0, 0, "made"),
        (0, 1, "made"),
        (1, 0, "before"),
        (1, 1, "made"),
        (4, 1, "before"),
        (4, 2, "made"),
        (2, 4, "made"),
    ],
)
def test_refits_judge_that_are_new_unless_there_are_too_few(before, made, judges):
    new = refits(made)
    known = EarlierRounds(refits(before)).refits_to_trust(new)
    assert (known is new) == (judges == "made")


def test_the_first_round_judges_by_its_own():
    assert EarlierRounds().refits_to_trust(new := refits(0)) is new


def test_doubts_of_a_round_are_kept_for_one_without_a_fit():
    estimate = Estimate(*np.arange(9.0).reshape(3, 3), ["identified"] * 3)
    doubted = replace(estimate, verdict=["weak"] * 3)
    assert EarlierRounds(refits(1), estimate).with_doubts(doubted).estimate is doubted
    assert EarlierRounds().with_doubts(doubted).estimate is None  # no fit: guesses are not kept


def test_it_survives_json():
    """Of a checkpoint, which may hold NaN: a misfit that is unknown."""
    estimate = Estimate(*np.arange(9.0).reshape(3, 3), ["weak"] * 3, correlation=np.eye(3))
    earlier = EarlierRounds(refits(2), estimate)
    back = EarlierRounds.from_json(json.loads(json.dumps(earlier.to_json())))
    for key in ("errors", "is_moving", "usual_std", "unfitted"):
        one, other = getattr(back.refits, key), getattr(earlier.refits, key)
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
    assert repr(back.refits.misfits) == repr(earlier.refits.misfits)  # NaN is not itself
    np.testing.assert_array_equal(back.estimate.low, estimate.low)
    none = EarlierRounds.from_json(json.loads(json.dumps(EarlierRounds(refits(0)).to_json())))
    assert none.refits.errors.shape == (0, 3)
    assert none.estimate is None


def test_what_an_older_version_wrote_is_said_to_be_of_one():
    with pytest.raises(InputError, match=r"fields \(bootstrap, refits\): go on with the former"):
        EarlierRounds.from_json({"bootstrap": None, "estimate": None})
