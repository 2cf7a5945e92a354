"""A budget in which networks alone will have the say is said to be one before minutes are spent."""

from types import SimpleNamespace

import pytest
from search_context import context_of

from simtune.experiment import enough_time
from simtune.tasks import load_task
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.search import TimeNeeded


@pytest.fixture(scope="module")
def context():
    return context_of(load_task("cartpole").simulator(image_size=32))


@pytest.mark.parametrize(
    ("minutes", "sensors", "is_said"),
    [
        (6.0, (), True),  # 340 s of 1309
        (6.0, ("encoders",), True),
        (6.9, (), False),  # .3 of them
    ],
)
def test_a_budget_hardly_enough_for_a_fit_says_what_to_expect_and_what_is_cheaper(
    context, tiny, caplog, minutes, sensors, is_said
):
    search = PosteriorSearch(context, tiny)
    search.context = SimpleNamespace(can_fit=True, observation=SimpleNamespace(sensors=sensors))
    with caplog.at_level("INFO", "simtune"):
        enough_time.say_if_unfitted(search, minutes, 20.0, TimeNeeded(250.0, 1309.0))
    assert bool(caplog.text) == is_said
    if is_said:
        assert "In --budget-minutes 6 there is hardly time to fit anything" in caplog.text
        assert "first guesses by networks, whose intervals nothing tests" in caplog.text
        assert "A fit needs --budget-minutes 12; it is cheaper with fewer" in caplog.text
        assert ("--observe joints" in caplog.text) == bool(sensors)


def test_nothing_of_fits_is_said_where_none_is_possible(context, tiny, caplog):
    search = PosteriorSearch(context, tiny)
    search.context = SimpleNamespace(can_fit=False)
    with caplog.at_level("INFO", "simtune"):
        enough_time.say_if_unfitted(search, 6.0, 20.0, TimeNeeded(250.0, 1309.0))
        other = SimpleNamespace(measure_time=None)  # of readings alone, or by the paper
        enough_time.say_if_unfitted(other, 6.0, 20.0, TimeNeeded(250.0, 1309.0))
    assert not caplog.text


def test_time_that_readings_take_first_is_no_time_for_a_fit(context, tiny, caplog):
    search = PosteriorSearch(context, tiny)
    search.context = SimpleNamespace(
        can_fit=True, observation=SimpleNamespace(sensors=("encoders",))
    )
    with caplog.at_level("INFO", "simtune"):
        for first_s in (0.0, 50.0, 1e4):  # of 393 s of 1309; 10⁴ s are half of 414 s at most
            enough_time.say_if_unfitted(
                search, 6.9, 20.0, TimeNeeded(250.0, 1309.0, first_s=first_s)
            )
            said, is_first = caplog.text, first_s == 0
            assert ("hardly time to fit anything" not in said) == is_first
            caplog.clear()
    # Half of a round and 20 s are 675 s, and readings take as much
    assert "A fit needs --budget-minutes 23" in said
