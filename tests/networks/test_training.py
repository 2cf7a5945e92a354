"""When a training is over, how fast it learns, and what it says meanwhile."""

import math
import time

import numpy as np
import pytest
import torch
from torch import nn

from simtune.budget import Budget
from simtune.networks.training import TrainingClock, train_network


class Clock:
    """Seconds that pass when told to."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "monotonic", clock)
    return clock


# --- budgets ------------------------------------------------------------------------------


def test_budget_counts_down_and_is_over_at_its_end(clock):
    budget = Budget(10.0)
    assert (budget.seconds_left, budget.spent, budget.is_over) == (10, 0, False)
    clock.now_s += 4
    assert (budget.seconds_left, budget.spent) == (6, pytest.approx(0.4))
    clock.now_s += 8
    assert (budget.seconds_left, budget.is_over) == (0, True)
    assert budget.spent == pytest.approx(1.2)


def test_budget_without_a_limit_is_never_over(clock):
    budget = Budget()
    clock.now_s += 1e9
    assert (budget.spent, budget.is_over, budget.seconds_left) == (0, False, math.inf)


def test_part_of_a_budget_reports_in_its_stretch_of_the_bar(clock):
    reports = []
    whole = Budget(100.0, lambda *said: reports.append(said))
    half = whole.part(40.0, (0.5, 1.0), "2/2 ")
    fifth = half.part(10.0, (0.2, 0.4), "then ")
    whole.report("begin")
    half.report("half", 0.5)
    fifth.report("inner", 0.5)
    fifth.report("never more than all of it", 7.0)
    assert [doing for doing, _ in reports] == [
        "begin",
        "2/2 half",
        "2/2 then inner",
        "2/2 then never more than all of it",
    ]
    np.testing.assert_allclose([done for _, done in reports], [0, 0.75, 0.65, 0.7])
    clock.now_s += 10
    assert fifth.is_over
    assert half.seconds_left == 30


# --- the clock of a training --------------------------------------------------------------


def test_training_is_as_far_as_its_updates_or_its_time(clock):
    reports = []
    budget = Budget(10.0, lambda doing, done: reports.append((doing, done)))
    training = TrainingClock(100, budget, "learning")
    assert training.fraction == 0
    for _ in range(40):
        training.step()
    assert training.fraction == 0.4
    clock.now_s += 5  # half of the time, but less of the updates
    assert training.fraction == 0.5
    assert reports == [("learning", 0.2), ("learning", 0.4)]
    clock.now_s += 50
    assert training.fraction > 1
    for _ in range(20):
        training.step()
    assert reports[-1] == ("learning", 1.0)  # never more than all


def test_training_without_a_budget_is_limited_by_updates_only(clock):
    training = TrainingClock(10)
    clock.now_s += 1e9
    for done in range(10):
        assert training.fraction == done / 10
        training.step()
    assert training.fraction == 1


def test_training_out_of_time_ends_after_its_least_updates(clock):
    training = TrainingClock(10**9, Budget(0.0), least_updates=2)
    clock.now_s += 1
    assert training.fraction == 0
    training.step()
    assert training.fraction == 0.5
    training.step()
    assert training.fraction == 1


def test_learning_rate_warms_up_and_falls_to_nearly_nothing():
    training, rates = TrainingClock(1000), []
    for _ in range(1000):
        rates.append(training.learning_rate(2.0))
        training.step()
    assert rates[0] == pytest.approx(2 / 50)
    assert np.argmax(rates) == 49
    assert (np.diff(rates[50:]) <= 0).all()
    assert rates[500] == pytest.approx(1.0)
    assert 0 < rates[-1] < 0.05


# --- the loop -----------------------------------------------------------------------------


def test_train_network_takes_all_updates_and_reaches_the_minimum():
    torch.manual_seed(0)
    network, goal = nn.Linear(2, 1), torch.tensor([[3.0, -1.0]])
    training, inputs = TrainingClock(400), torch.randn(400, 16, 2)
    drawn = iter(inputs)

    def draw_loss() -> torch.Tensor:
        given = next(drawn)
        return (network(given) - given @ goal.T - 0.5).square().mean()

    loss = train_network(network, draw_loss, training, 0.1, weight_decay=0.0)
    assert training.updates == 400
    assert loss < 1e-3
    torch.testing.assert_close(network.weight.detach(), goal, atol=0.02, rtol=0)


def test_train_network_returns_the_mean_of_the_last_fifty_losses():
    network, losses = nn.Linear(1, 1), iter(range(80))

    def draw_loss() -> torch.Tensor:
        return 0 * network.weight.sum() + float(next(losses))

    assert train_network(network, draw_loss, TrainingClock(80), 0.0) == np.mean(range(30, 80))


def test_train_network_clips_gradients_to_the_largest_norm():
    network, norms = nn.Linear(3, 1, bias=False), []
    network.weight.register_post_accumulate_grad_hook(lambda p: norms.append(p.grad.norm().item()))

    def draw_loss() -> torch.Tensor:
        if network.weight.grad is not None:
            norms.append(network.weight.grad.norm().item())
        return 100 * network.weight.sum()

    train_network(network, draw_loss, TrainingClock(2), 1e-3, largest_gradient=1.0)
    raw, clipped, _ = norms
    assert raw > 100
    assert clipped == pytest.approx(1.0, rel=1e-4)
