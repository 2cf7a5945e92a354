"""search="posterior" as a whole: what a round gives, that it resumes, and that it finds."""

import itertools
import json
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
import torch
from search_context import CARTPOLE, SIZE, SPACE, START, STEPS, context_of, record_episodes

from simtune.budget import Budget
from simtune.errors import InputError
from simtune.experiment.search_settings import make_search
from simtune.fit import PointEstimate
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.real.truth import Truth
from simtune.simulation import Simulator
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning import familiarity
from simtune.tuning.earlier_rounds import EarlierRounds
from simtune.tuning.estimate import Estimate
from simtune.tuning.learning import Detected, LearningResult
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.rounds import RoundTime
from simtune.tuning.search import Callbacks, Event, Round, SearchContext
from simtune.vision.keypoints import find_keypoints


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return CARTPOLE.simulator(image_size=SIZE)


@pytest.fixture(scope="module")
def real(simulator) -> list[Trajectory]:
    return record_episodes(simulator, 3)


def start(simulator: Simulator, config: PosteriorSearchConfig, seed: int = 0) -> PosteriorSearch:
    return PosteriorSearch(context_of(simulator, seed=seed), config)


class Saved(NamedTuple):
    """What a later process has of a search."""

    tensors: dict[str, torch.Tensor]
    state: dict

    @classmethod
    def of(cls, search: PosteriorSearch) -> "Saved":
        tensors = {name: tensor.clone() for name, tensor in search.tensors().items()}
        return cls(tensors, json.loads(json.dumps(search.state())))

    def load(self, config: PosteriorSearchConfig, seed: int = 0) -> PosteriorSearch:
        """Into another process's search."""
        search = start(CARTPOLE.simulator(image_size=SIZE), config, seed)
        search.load(self.tensors, self.state)
        return search


class Straight(NamedTuple):
    """A search that was never interrupted, of two rounds."""

    config: PosteriorSearchConfig
    rounds: list[Round]
    steps: list[int]  # simulated in each
    stop_reasons: list[str]  # before each, and at last
    within_first: Saved
    after: list[Saved]
    reported: list[tuple[str, float]]


STRAIGHT_SEED = 4


@pytest.fixture(scope="module")
def straight(simulator, real, tiny) -> Straight:
    config = replace(tiny, detector_updates=(40,), posterior_updates=40)  # enough to report
    search, within = start(simulator, config, STRAIGHT_SEED), []
    np.testing.assert_array_equal(search.distribution.mean, START)
    made = Straight(config, [], [], [search.stop_reason], cast(Saved, None), [], [])
    budget = Budget(report=lambda doing, done: made.reported.append((doing, done)))
    for _ in range(tiny.num_rounds):
        steps = simulator.num_steps
        save = Callbacks(save=lambda: within.append(Saved.of(search)))
        made.rounds.append(search.run_round(real, budget, save))
        made.steps.append(simulator.num_steps - steps)
        made.stop_reasons.append(search.stop_reason)
        made.after.append(Saved.of(search))
    assert len(within) == tiny.num_rounds
    return made._replace(within_first=within[0])


@pytest.fixture(scope="module")
def judged(simulator, real, tiny) -> tuple[Estimate, list[Estimate], Saved]:
    """A whole round's estimate, what was told before it was judged, and its search."""
    told: list[Estimate] = []
    search = start(simulator, replace(tiny, num_rounds=1))
    estimate = search.run_round(real, Budget(1e6), Callbacks(report_early=told.append)).estimate
    return estimate, told, Saved.of(search)


@pytest.mark.thorough
def test_rounds_give_estimates_and_ranges_within_bounds(straight):
    for (estimate, _, metrics), steps in zip(straight.rounds, straight.steps, strict=True):
        assert steps >= straight.config.num_worlds * 2 * STEPS
        for values in (estimate.mean, estimate.low, estimate.high):
            assert values.shape == (len(SPACE),)
            np.testing.assert_array_equal(values, SPACE.clip(values))
        assert (estimate.low <= estimate.high).all()
        assert set(estimate.curves) == set(SPACE.names)
        assert set(estimate.verdict) <= {"identified", "weak", "not identifiable"}
        assert np.isfinite(list(metrics.values())).all()
    assert straight.stop_reasons == ["", "", "all rounds are done"]
    first, second = straight.rounds
    assert set(first.metrics) == set(second.metrics)


def test_the_detector_is_judged_in_worlds_as_near_the_real_one_as_its_start_tells(
    monkeypatch, simulator, real, tiny
):
    search, std = start(simulator, tiny), np.full(len(SPACE), 0.02)
    std[0] = 1.0  # nothing is known: drawn from all that is searched
    known = PointEstimate(START, std)
    learning, searched = search._learning, search.distribution
    others = learning.hold_out(real, searched, Budget())
    nothing = np.empty(0)
    learned = LearningResult(searched, nothing, others, Detected(real, []), nothing)
    near = learning.film_near(learned, known, Budget()).worlds
    assert near.frames.shape[:2] == (tiny.near_worlds, tiny.near_steps)
    away = np.abs(SPACE.to_unit(near.parameters) - SPACE.to_unit(START))
    assert (away[:, 1:] <= 0.05 + 1e-9).all()
    assert away[:, 1:].max() > 0.03
    assert away[:, 0].max() > 0.2
    assert (near.parameters >= searched.low - 1e-9).all()
    assert (near.parameters <= searched.high + 1e-9).all()
    roll_out = simulator.roll_out
    monkeypatch.setattr(simulator, "roll_out", lambda *given: roll_out(*given).only(slice(0)))
    assert learning.film_near(learned, known, Budget()) is others


def test_make_search_makes_the_search_of_that_name(simulator, tiny):
    made = make_search("posterior", context_of(simulator), tiny)
    assert isinstance(made, PosteriorSearch)
    assert made.config is tiny


def test_episodes_too_short_for_the_posterior_network_are_refused(simulator, real, tiny):
    search = start(simulator, tiny)
    short = Trajectory(real[0].frames[:11], real[0].actions[:10], 0.1)
    with pytest.raises(
        InputError, match="episode 1, counted from 0, has 10 steps; expected at least 21"
    ):
        search.check([real[0], short])
    with pytest.raises(InputError, match="no episodes"):
        search.check([])
    search.check(real)


def same_estimates(one, other) -> None:
    for key in ("mean", "low", "high"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key))
    assert one.verdict == other.verdict
    np.testing.assert_array_equal(one.correlation, other.correlation)
    for name, (candidates, prob_higher) in one.curves.items():
        np.testing.assert_array_equal(candidates, other.curves[name][0])
        np.testing.assert_array_equal(prob_higher, other.curves[name][1])


def ends_as(search: PosteriorSearch, saved: Saved) -> None:
    """Its tensors and its state are the same bit for bit."""
    for name, tensor in saved.tensors.items():
        assert torch.equal(tensor, search.tensors()[name]), name
    assert json.dumps(search.state()) == json.dumps(saved.state)  # NaN is itself there


@pytest.mark.thorough
def test_resumed_search_repeats_a_straight_one_bit_for_bit(straight, real):
    begun, ended = straight.after
    resumed = begun.load(straight.config, STRAIGHT_SEED)
    assert resumed.num_rounds == 1
    for key in ("mean", "low", "high"):
        expected = np.array(begun.state["distribution"][key])
        np.testing.assert_array_equal(getattr(resumed.distribution, key), expected)
    torch.rand(7)  # what others draw from torch does not matter
    np.random.rand(7)  # noqa: NPY002  nor from numpy
    expected_estimate, expected_events, expected_metrics = straight.rounds[1]
    estimate, events, metrics = resumed.run_round(real, Budget())
    same_estimates(estimate, expected_estimate)
    assert events == expected_events
    assert metrics == expected_metrics
    assert resumed.num_rounds == 2
    ends_as(resumed, ended)


@pytest.mark.thorough
def test_a_round_that_was_cut_off_goes_on_with_its_detector_bit_for_bit(
    straight, real, monkeypatch
):
    resumed = straight.within_first.load(straight.config, STRAIGHT_SEED)
    assert resumed.num_rounds == 0
    with monkeypatch.context() as patch:
        patch.setattr(resumed.model, "train_detector", None)
        again = resumed.run_round(real, Budget())
    expected, events, metrics = straight.rounds[0]
    same_estimates(again.estimate, expected)
    assert (again.events, again.metrics) == (events, metrics)
    ends_as(resumed, straight.after[0])


@pytest.mark.thorough
def test_seed_decides_the_estimate(straight, simulator, real):
    same, another = (
        start(simulator, straight.config, seed).run_round(real, Budget()).estimate
        for seed in (STRAIGHT_SEED, 2)
    )
    one = straight.rounds[0].estimate
    same_estimates(one, same)
    assert not np.array_equal(one.mean, another.mean)


def over() -> Budget:
    """A budget of which nothing is left."""
    budget = Budget(1e-3)
    time.sleep(0.01)
    assert budget.is_over
    return budget


@pytest.mark.thorough
def test_round_out_of_time_makes_its_least_updates_and_still_estimates(simulator, real, tiny):
    config = replace(tiny, detector_updates=(10**9,), posterior_updates=10**9, least_updates=5)
    estimate, _, _ = start(simulator, config).run_round(real, over())  # or it would never end
    assert np.isfinite(estimate.mean).all()


def num_refits(estimate: Estimate) -> set[int]:
    """Of each parameter."""
    return {len(ranks) for ranks in estimate.ranks.values()}


@pytest.mark.thorough
def test_a_round_is_judged_by_refits_unless_time_is_over_or_another_will_follow(
    simulator, real, tiny, judged, straight
):
    assert num_refits(judged[0]) == {tiny.most_refits}
    first, last = (round_.estimate for round_ in straight.rounds)
    assert num_refits(last) == {tiny.planned_refits}
    assert num_refits(first) == set(), "what is fitted once more needs no refits"
    assert num_refits(start(simulator, tiny).run_round(real, over()).estimate) == set()


@pytest.mark.thorough
def test_a_fit_is_told_before_it_is_judged_and_not_called_sure(judged):
    estimate, (early,), _ = judged
    assert "identified" not in early.verdict
    assert not early.ranks
    assert (np.abs(early.mean - estimate.mean) < early.high - early.low).all()
    assert any("no time to fit a known world" in warning for warning in early.warnings)


@pytest.mark.thorough
def test_a_round_without_time_for_its_fit_keeps_that_of_the_round_before(
    simulator, real, tiny, judged
):
    estimate, _, saved = judged
    assert num_refits(estimate) == {tiny.most_refits}
    # The fit that was not finished is of no use, also in a later session
    later = saved.load(replace(tiny, num_rounds=1))
    kept = later.run_round(real, over()).estimate
    same_estimates(kept, estimate)
    assert later.run_round(real, over()).estimate is kept


@pytest.mark.thorough
def test_progress_is_reported_and_never_goes_back(straight):
    shares = [done for _, done in straight.reported]
    assert all(a <= b + 1e-9 for a, b in itertools.pairwise(shares))
    assert 0 <= shares[0] < shares[-1] <= 1
    words = [doing for doing, _ in straight.reported]
    assert {w.split(": ")[0] for w in words} == {"round 1", "round 2"}
    assert {w.split(": ")[1] for w in words} >= {
        "simulating and filming",
        "training the detector",
        "fitting",
    }


@pytest.mark.slow
def test_search_finds_the_truth_of_a_ball_and_a_cup():
    task = load_task("ball_in_cup")
    space = task.parameters
    truth = Truth(space, space.nominal)
    simulator = task.simulator(image_size=64)
    world = truth.make_real(simulator, episode_steps=task.episode_steps, seed=5)
    real, begun = world.collect(4), truth.wrong_start(5)
    first = Distribution.first(space, begun)
    context = SearchContext(
        simulator=simulator,
        keypoints=find_keypoints(simulator, first, 5),
        start=begun,
        observation=ObservationModel.of_simulator(),
        seed=5,
    )
    config = PosteriorSearchConfig(
        num_worlds=128, num_rounds=3, detector_updates=(1200, 500), posterior_updates=700
    )
    search = PosteriorSearch(context, config)
    for _ in range(config.num_rounds):
        estimate, _, _ = search.run_round(real, Budget())
    _, percent_error = truth.score(estimate.mean)
    assert truth.score(begun)[1].mean() > 40
    assert percent_error.mean() < 15, dict(zip(space.names, percent_error, strict=True))
    assert estimate.verdict[space.index("ball_mass")] != "not identifiable"
    inside = (estimate.low <= space.nominal) & (space.nominal <= estimate.high)
    assert inside.mean() >= 0.6  # 90 % intervals, of few updates


@pytest.mark.thorough
@pytest.mark.parametrize("is_strange", [False, True])
def test_videos_of_a_robot_where_no_world_gets_are_said_to_be_so(
    simulator, real, tiny, monkeypatch, is_strange
):
    """Real episodes in which everything stands elsewhere, or the simulator's own."""
    place = "simtune.tuning.posterior.measure_strangeness"
    compare, told = familiarity.measure_strangeness, []

    def moved(worlds: np.ndarray, held_out, detected) -> familiarity.Strangeness:
        off = 40.0 * is_strange
        films = [found._replace(keypoints=found.keypoints + off) for found in detected.detections]
        told.append(compare(worlds, held_out, Detected(detected.trajectories, films)))
        return told[-1]

    monkeypatch.setattr(place, moved)
    estimate, _, _ = start(simulator, replace(tiny, num_rounds=1)).run_round(real, Budget())
    assert [found.clearly for found in told] == [is_strange]
    assert (familiarity.STRANGE in estimate.warnings) == is_strange
    if is_strange:
        assert "identified" not in estimate.verdict


def test_what_had_no_time_in_one_round_is_told_of_that_round_only():
    """A later round without a fit has the earlier one's estimate."""
    search = PosteriorSearch.__new__(PosteriorSearch)
    fitted = Estimate(np.zeros(1), np.zeros(1), np.ones(1), ["weak"], {}, warnings=["of the fit"])
    search._earlier, search._times = EarlierRounds(None, fitted), None
    told = SimpleNamespace(warnings=[], fit=lambda *_: None)
    search._readings_first = cast(Any, told)
    search._plan = lambda real, budget: RoundTime(budget, True, budget)
    search._learn = lambda *_: (cast(Any, SimpleNamespace(searched=None)), {})
    search._judge = lambda *_: (cast(Any, search._earlier.estimate), np.zeros(0))

    def move(estimate: Estimate, *_: object) -> tuple[Estimate, list[Event]]:
        search._earlier = search._earlier.with_doubts(estimate)
        return estimate, []

    search._move = move
    for seconds in (30, 20):
        told.warnings = [f"there were {seconds} s for readings"]
        found = search.run_round([], Budget()).estimate.warnings
        assert found == [f"there were {seconds} s for readings", "of the fit"]
