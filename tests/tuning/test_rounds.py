"""How a search plans its rounds, and when it stops: by hand arithmetic."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from search_context import SPACE, context_of, record_episodes

from simtune.budget import Budget, OutOfTime
from simtune.fit import FitConfig, FitWork, PointEstimate, ReplayFit, count_fit_steps
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace, dynamics
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.tasks import load_task
from simtune.tuning.estimate import Estimate
from simtune.tuning.fitting import Fitted, Fitting
from simtune.tuning.judging import Judging
from simtune.tuning.pace import Pace, Work, smallest
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.range_update import read_curves
from simtune.tuning.refit_plan import RefitPlan
from simtune.tuning.round_times import RoundTimes
from simtune.tuning.rounds import Rounds, gains_nothing, half_widths, is_precise, plan_round
from simtune.tuning.survival_curves import normal_curves
from simtune.vision.detector_noise import DetectorNoise
from simtune.vision.image_noise import ImageNoise

# --- when to begin and to end -------------------------------------------------------------


@pytest.mark.parametrize(
    ("seconds_left", "is_last", "planned_s"),
    [
        (600, False, 150),  # half as long again as a whole first one
        (280, False, 140),  # half of what is left
        (250, False, 125),
        (249, False, 249),  # not enough for two
        (30, False, 30),
        (0, False, 0),
        (600, True, 600),
    ],
)
def test_a_round_gets_its_time_or_all_that_is_left(seconds_left, is_last, planned_s):
    assert plan_round(seconds_left, 100.0, is_last) == planned_s


def test_half_widths_are_relative_to_estimates_or_to_the_range_where_those_may_be_0():
    mass = dynamics("mass", "body_mass", ("pole_1",), nominal=2.0, unit="kg")
    offset = replace(
        mass, name="offset", field="actuator_gear", low=-1.0, high=1.0, nominal=0.1, scale="linear"
    )
    dark, bright = (replace(offset, name=name, low=0.0) for name in ("dark", "bright"))
    space = ParameterSpace([mass, offset, dark, bright])
    starts, lows = np.array([2.0, 0.1, 0.5, 0.5]), np.array([1.0, -0.5, 0.0, 0.0])
    first = Distribution(space, starts, lows, np.array([4.0, 0.5, 1.0, 1.0]))
    low, high = np.array([1.9, -0.2, 0.0, 0.4]), np.array([2.3, 0.2, 0.01, 0.6])
    estimate = Estimate(np.array([2.0, 0.0, 0.004, 0.5]), low, high, ["weak"] * 4)
    # .2 of 2, .2 of 1, .005 of a tenth, .1 of .5
    np.testing.assert_allclose(half_widths(estimate, first), [0.1, 0.2, 0.05, 0.2])


def test_a_search_is_precise_if_every_interval_is_narrow():
    assert is_precise(np.array([0.01, 0.005]), 0.01)
    assert not is_precise(np.array([0.011, 0.005]), 0.01)


def test_a_round_gains_nothing_if_no_wide_interval_becomes_a_fifth_narrower():
    before = np.array([0.1, 0.02])
    assert gains_nothing(before, np.array([0.081, 0.02]), 0.01)
    assert not gains_nothing(before, np.array([0.079, 0.02]), 0.01)
    assert not gains_nothing(before, np.array([0.1, 0.015]), 0.01)
    assert gains_nothing(before, np.array([0.1, 0.009]), 0.01), "narrow enough: does not count"


def test_rounds_that_no_known_world_judged_end_no_search():
    """They ask for more minutes, and the same command must be able to use them."""
    for widths in ([0.30, 0.25], [0.005, 0.004]):
        rounds = Rounds(4, 0.01)
        for width in widths:
            rounds.end(np.array([width]), is_judged=False)
        assert rounds.stop_reason == ""
        rounds.end(np.array([0.24]))
        assert rounds.stop_reason == ""  # nothing to compare with
        rounds.end(np.array([0.23]))
        assert rounds.stop_reason == "another round would tell hardly more"


def test_rounds_that_lacked_time_end_no_search_however_many_they_are():
    """A single known world, or no fit of readings: "the same command with a larger budget"."""
    rounds = Rounds(2, 0.01)
    for width in (0.005, 0.005, 0.005):
        rounds.end(np.array([width]), lacked_time=True)
    assert (rounds.stop_reason, rounds.num_done) == ("", 3)
    rounds.end(np.array([0.005]))
    assert rounds.stop_reason == "every parameter is known to 1 %"


@pytest.mark.parametrize(
    ("num_known", "num_diverged", "most", "is_endless", "lacks"),
    [
        (0, 0, 8, False, True),
        (1, 0, 8, False, True),
        (1, 0, 1, False, False),  # no more were to be fitted
        (2, 0, 8, False, False),
        (0, 2, 8, False, False),  # more would diverge as well
        (1, 0, 8, True, False),
    ],
)
def test_a_search_with_a_single_known_world_goes_on_with_a_larger_budget(
    monkeypatch, simulator, first_round, tiny, num_known, num_diverged, most, is_endless, lacks
):
    real, learned, judged = first_round
    refits = replace(
        judged.earlier.refits,
        misfits=judged.earlier.refits.misfits[:1] * num_known,
        num_diverged=num_diverged,
    )
    earlier = replace(judged.earlier, refits=refits)
    monkeypatch.setattr(PosteriorSearch, "_learn", lambda *_: learned)
    monkeypatch.setattr(Judging, "judge", lambda *_: judged._replace(earlier=earlier))
    for for_policy in (False, True):
        config = replace(tiny, num_rounds=1, precision=1e9, for_policy=for_policy)
        search = PosteriorSearch(context_of(simulator), replace(config, most_refits=most))
        search._times = RoundTimes(1.0, 2.0, 0.01)
        search.run_round(real, Budget() if is_endless else Budget(1e6))
        assert bool(search.stop_reason) != (lacks and not for_policy)


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return load_task("cartpole").simulator(image_size=32)


@pytest.fixture(scope="module")
def first_round(simulator, tiny) -> tuple:
    """Episodes, what a whole round learns of them, and how it is judged."""
    real, found = record_episodes(simulator, 1), []
    search = PosteriorSearch(context_of(simulator), replace(tiny, num_rounds=1))

    def keep(work):
        def kept(*given):
            found.append(work(*given))
            return found[-1]

        return kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_learn", keep(search._learn))
        patch.setattr(Judging, "judge", keep(Judging.judge))
        search.run_round(real, Budget())
    learned, judged = found
    return real, learned, judged


@pytest.fixture
def rounds_until_stop(monkeypatch, simulator, first_round):
    """How many rounds are done where their intervals are so wide, and why no more.

    All learn and find what one did: nothing else than widths and verdicts matters.
    """
    real, learned, judged = first_round

    def count(config, widths: list, verdict: str = "identified") -> tuple[int, str]:
        left = iter(widths)
        estimate = replace(judged.estimate, verdict=[verdict] * len(SPACE))
        monkeypatch.setattr(PosteriorSearch, "_learn", lambda *_: learned)
        monkeypatch.setattr(Judging, "judge", lambda *_: judged._replace(estimate=estimate))
        monkeypatch.setattr(
            "simtune.tuning.posterior.half_widths",
            lambda estimate, first: np.full(len(SPACE), next(left)),
        )
        search = PosteriorSearch(context_of(simulator), config)
        while not search.stop_reason:
            search.run_round(real, Budget())
        return search.num_rounds, search.stop_reason

    return count


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("precision", "widths", "rounds", "reason"),
    [
        (0.02, [0.3, 0.019], 2, "every parameter is known to 2 %"),
        (0.01, [0.3, 0.1, 0.09], 3, "another round would tell hardly more"),
        (0.01, [0.3, 0.2, 0.1, 0.05], 4, "all rounds are done"),
        (0.01, [0.3, 0.3, 0.1, 0.05], 4, "all rounds are done"),  # the second had no fit
        (0.0, [0.3, 0.3, 0.3, 0.0], 4, "all rounds are done"),  # asked to go on
    ],
)
def test_a_search_says_why_it_stops(rounds_until_stop, tiny, precision, widths, rounds, reason):
    config = replace(tiny, num_rounds=4, precision=precision)
    assert rounds_until_stop(config, widths) == (rounds, reason)


def test_narrow_intervals_of_an_unsound_simulator_are_not_enough_for_a_policy(
    rounds_until_stop, tiny
):
    config = replace(tiny, num_rounds=2, precision=0.02, for_policy=True)
    stopped = rounds_until_stop(config, [0.01, 0.005], "weak")
    assert stopped == (2, "another round would tell hardly more")


@pytest.mark.parametrize(
    ("location", "reason"),
    [(0.5, "every parameter is known"), (1.1, "every parameter is known"), (1.4, "")],
)
def test_a_search_goes_on_where_the_next_round_reaches_farther(simulator, tiny, location, reason):
    """Curves end at 1.25, and any interval is narrow enough."""
    context = context_of(simulator)
    search = PosteriorSearch(context, replace(tiny, num_rounds=4, precision=1e9))
    first = search.distribution
    middle = np.where(np.arange(len(SPACE)) == SPACE.index("pole_mass"), location, 0.5)
    curves = normal_curves(middle, np.full(len(SPACE), 0.01))
    read = read_curves(curves, first, first)
    judged = replace(read, ranks={name: [0.5] for name in SPACE.names})
    _, events = search._move(judged, curves, first)
    assert search.stop_reason.startswith(reason)
    assert bool(search.stop_reason) == bool(reason)
    assert ("widened" in {event.event for event in events}) == (location > 1)


@pytest.mark.parametrize(
    ("noise", "rounds", "reason"),
    [
        (ImageNoise(), 1, "every parameter of the motion is known to 5 %"),
        (None, 2, "all rounds are done"),  # colours are to be known as well
    ],
)
def test_a_search_for_a_policy_need_not_know_colours_before_a_real_camera(
    monkeypatch, rounds_until_stop, tiny, noise, rounds, reason
):
    monkeypatch.setattr(ObservationModel, "image_noise", noise)
    config = replace(tiny, num_rounds=2, precision=0.05, for_policy=True, tolerates_brightness=True)
    widths = [np.where(SPACE.is_appearance, wide, 0.04) for wide in (0.5, 0.3)]
    stopped = rounds_until_stop(config, widths)
    assert stopped == (rounds, reason)


def test_a_round_without_time_for_its_fit_tells_what_networks_guess(monkeypatch, simulator, tiny):
    """But what is known; other colours are as unsure as a camera makes them."""

    def take_too_long(*given):
        raise OutOfTime

    monkeypatch.setattr("simtune.fit.ReplayFit.fit", take_too_long)
    real, known = record_episodes(simulator, 1), np.full(len(SPACE), np.nan)
    first, *others = np.flatnonzero(SPACE.is_appearance)
    known[first] = 0.62
    context = replace(context_of(simulator), known=known)
    estimate = PosteriorSearch(context, tiny).run_round(real, Budget()).estimate
    assert "identified" not in estimate.verdict
    (warning,) = estimate.warnings
    assert warning.startswith("There was no time to fit the simulator")
    assert "Nor was any interval tested" in warning
    assert ((estimate.low <= estimate.mean) & (estimate.mean <= estimate.high)).all()
    np.testing.assert_allclose([estimate.low[first], estimate.high[first]], 0.62, atol=1e-3)

    monkeypatch.setattr(ObservationModel, "discrepancy_std", lambda self, colours: 0.1 * colours)
    blurred = PosteriorSearch(context, tiny).run_round(real, Budget()).estimate
    is_other = [
        not np.array_equal(blurred.curves[name][1], estimate.curves[name][1])
        for name in SPACE.names
    ]
    assert np.flatnonzero(is_other).tolist() == others


def test_a_fit_that_takes_far_too_long_is_done_again_as_small_as_may_be(
    monkeypatch, simulator, tiny
):
    sizes, fit = [], ReplayFit.fit

    def fit_if_small(self, *given):
        sizes.append(self.is_least)
        if not self.is_least:
            raise OutOfTime
        return fit(self, *given)

    monkeypatch.setattr(ReplayFit, "fit", fit_if_small)
    search = PosteriorSearch(context_of(simulator), replace(tiny, num_rounds=1))
    round_ = search.run_round(record_episodes(simulator, 1), Budget(1e4))
    assert sizes[:2] == [False, True]
    assert len(sizes) > 2, "it is judged by refits"
    assert all(sizes[1:]), "which are as small"
    assert not any("no time to fit" in warning for warning in round_.estimate.warnings)


def test_a_fit_is_done_again_where_the_detector_errs_otherwise_at_its_colours(
    monkeypatch, simulator, tiny
):
    """Known worlds are then found with the errors of that second test as well."""
    fits, measured, fit, differs = [], [], Fitting._fit, iter([True, False])

    def remember(self, replay_fit, observed, start, *given):
        noise_px = observed.evidence.parts[0].noise_px
        fits.append((noise_px, start, fit(self, replay_fit, observed, start, *given)))
        return fits[-1][-1]

    def is_off(self, other):
        measured.append((self, other))
        return next(differs)

    monkeypatch.setattr(Fitting, "_fit", remember)
    monkeypatch.setattr(DetectorNoise, "is_off", is_off)
    colours = SPACE.is_appearance
    for is_repeated in (True, False):
        search = PosteriorSearch(context_of(simulator), replace(tiny, num_rounds=1))
        search.run_round(record_episodes(simulator, 1), Budget())
        (new, old), (first, start, found) = measured[-1], fits[0]
        assert len(fits) == 1 + is_repeated
        np.testing.assert_array_equal(first, old.usual_px)
        assert (new.usual_px != old.usual_px).any()
        if is_repeated:
            noise_px, again, _ = fits[1]
            np.testing.assert_array_equal(noise_px, new.usual_px)
            np.testing.assert_array_equal(again.parameters[colours], found.parameters[colours])
            np.testing.assert_array_equal(again.parameters[~colours], start.parameters[~colours])
        fits.clear()


@pytest.mark.parametrize(("left_s", "is_filmed"), [(79.0, False), (81.0, True)])
def test_a_fit_is_done_again_only_if_that_leaves_time_to_judge_it(left_s, is_filmed):
    """Four times its 20 s; without such time, or where the second does not end, it stays."""
    filmed = []

    def film_near(learned, found, budget):
        filmed.append(found.std.tolist())
        return SimpleNamespace(noise=lambda: SimpleNamespace(is_off=lambda other: True))

    @dataclass(frozen=True)
    class FakeObserving:
        noise: object

        def observed(self, *detected):
            return detected

    def fit_late(*given):
        raise OutOfTime

    found = SimpleNamespace(
        parameters=np.ones(2), std=np.array([0.01, 0.02]), is_moving=np.array([True, False])
    )
    fitting = SimpleNamespace(
        start=PointEstimate(np.zeros(2), np.array([0.3, 0.4])),
        learning=SimpleNamespace(film_near=film_near),
        finds_latency=True,
        learned=SimpleNamespace(detected=()),
        _fit=fit_late,
    )
    before: Any = FakeObserving("measured first")
    fitted = Fitted(found, cast(Any, None), before, 20.0)
    assert Fitting.again(cast(Fitting, fitting), fitted, Budget(left_s)) is fitted
    assert filmed == [[0.3, 0.02]] * is_filmed


@pytest.mark.parametrize(
    ("picture_s", "left_s", "refits"),
    [
        (0.0, 100, (8, 5)),  # a quarter of it is more than the fit's 20 s for its 5 episodes
        (0.04, 100, (8, 3)),  # 4 s more for the 100 pictures of each: 25 / 8
        (0.2, 75, (8, 3)),  # 20 s each, and half a fit
        (0.2, 65, (0, 3)),
    ],
)
def test_known_worlds_are_filmed_in_time_as_well(picture_s, left_s, refits):
    assert RefitPlan.within(Budget(left_s), (5, 99), 20.0, picture_s, SEARCH) == refits


# --- how long a round takes ---------------------------------------------------------------

STAGES = (Stage(4, 3, 2.0), Stage(10, 2))
FIT = FitConfig(num_particles=50, shooting=ShootingConfig(stages=STAGES, num_windows=30))
SEARCH = PosteriorSearchConfig(
    num_worlds=100,
    episodes_per_world=4,
    pictures_per_world=5,
    held_out_worlds=80,
    held_out_steps=10,
    near_worlds=12,
    near_steps=5,
    detector_updates=(300, 900),
    posterior_updates=250,
    state_updates=100,
    least_updates=150,
    planned_refits=5,
    most_refits=8,
    fit=FIT,
)
PACE = Pace(step_s=1e-3, frame_s=0.01, detect_s=0.02, update_s=0.1)


def test_steps_of_a_fit_by_hand():
    # Stages derive in every third iteration, by 9 worlds here, and try 2 worlds in each.
    per_window = 4 * (1 * 9 + 3 * 2) + 10 * (1 * 9 + 2 * 2)
    assert FIT.shooting.steps_per_window(9) == per_window == 190
    # As many steps once more, blurred and not, in 5 iterations each, of which 2 derive.
    longer = 2 * 10 * (2 * 9 + 5 * 2)
    assert FIT.shooting.steps_of_longer(9) == longer == 560
    # Of 200 steps 20 windows of the last stage's 10, from two sides; all that are asked for of 900.
    # The point itself, 4 unknowns of a state, and 2 parameters up and down make 9 worlds.
    assert count_fit_steps(FIT, FitWork(200, 4, 2)) == (200 * 50, 20 * (2 * 190 + 560))
    assert count_fit_steps(FIT, FitWork(900, 4, 2)) == (900 * 50, 30 * (2 * 190 + 560))


def test_a_smaller_fit_keeps_the_fewest_that_tell_anything():
    def size(config: FitConfig) -> tuple[int, int]:
        return config.num_particles, config.shooting.num_windows

    config = FitConfig(num_particles=200, shooting=ShootingConfig(stages=STAGES, num_windows=90))
    assert size(config.at_most(100, 36)) == (100, 36)
    assert config.at_most(100, 36).shooting.stages == STAGES
    assert size(config.at_most(40, 18)) == (40, 20)
    assert size(config.at_most(0, 0)) == (32, 20)
    assert config.at_most(300, 100) == config
    few = FitConfig(num_particles=8, shooting=ShootingConfig(num_windows=6))
    assert few.at_most(0, 0) == few, "no more than were asked for"
    assert size(config.least()) == (16, 12)
    assert size(config.least(50)) == (50, 12)
    assert size(config.least(300)) == (200, 12)
    assert config.least().shooting.longer == ()
    assert (config.num_pictures, config.least().num_pictures) == (40, 20)
    assert size(few.least()) == (8, 6)


def test_seconds_of_a_round_by_hand():
    # 2 episodes of 50 steps; 100 worlds play both, 80 held-out ones and 12 near the real one one.
    work = Work(num_episodes=2, num_steps=50, num_tangent=4, num_fitted=2)
    played_s = 1e-3 * 50 * (100 * 2 + 80 + 12)
    drawn_s = 0.01 * (100 * 5 + 80 * 10 + 12 * 5) + 0.02 * (80 * 10 + 12 * 5)
    updates_s = 0.1 * (300 + 0.7 * (250 + 100))
    fit_s = 1.3 * 1e-3 * (100 * 50 + 10 * (2 * 190 + 560))
    looked_s = 0.02 * 2 * 51 + 5 * 2 * 51 * (0.01 + 0.02)  # real frames, and those of refits
    # Two episodes are in refits, too
    expected = played_s + drawn_s + looked_s + updates_s + fit_s * (1 + 5)
    assert PACE.round_s(SEARCH, work) == pytest.approx(expected)
    # Each picture of four that are averaged takes four times as long, so a fourth is drawn.
    assert PACE.round_s(SEARCH, work._replace(supersampling=4)) == pytest.approx(
        expected - 0.75 * drawn_s
    )
    # A fit of colours draws its 40 pictures sixty times, and so do five refits.
    with_colours_s = PACE.round_s(SEARCH, work._replace(fits_pixels=True))
    assert with_colours_s == pytest.approx(expected + 6 * 60 * 40 * 0.01)


def test_seconds_of_a_round_without_a_fit_by_hand():
    # As above without worlds near the real one, and six times the worlds, of which nothing is
    # drawn, and the updates.
    played_s = 1e-3 * 50 * (100 * 2 + 80 + 600 * 2)
    drawn_s = 0.01 * (100 * 5 + 80 * 10) + 0.02 * 80 * 10
    updates_s = 0.1 * (300 + 0.7 * 6 * 250)
    found_s = PACE.round_s(SEARCH, Work(num_episodes=2, num_steps=50, num_tangent=0, num_fitted=2))
    looked_s = 0.02 * 2 * 51
    assert found_s == pytest.approx(played_s + drawn_s + looked_s + updates_s)


def test_seconds_of_a_machine_twice_as_slow_are_twice_as_many():
    slower = Pace(*(2 * seconds for seconds in vars(PACE).values()))
    for work in (Work(3, 200, 18, 4), Work(3, 200, 0, 4)):
        assert slower.round_s(SEARCH, work) == pytest.approx(2 * PACE.round_s(SEARCH, work))


@pytest.mark.parametrize(
    ("pace", "of_a_model", "of_an_environment"),
    [
        (replace(PACE, frame_s=1.0), "meshes, fewer cameras or a smaller --image-size", "render()"),
        (replace(PACE, step_s=1.0), "fixed_joints", "step()"),
    ],
)
def test_an_environment_steps_and_draws_by_itself(pace, of_a_model, of_an_environment):
    work = Work(num_episodes=2, num_steps=50, num_tangent=0, num_fitted=2)
    assert of_a_model in pace.mostly(SEARCH, work)
    said = pace.mostly(SEARCH, work._replace(is_environment=True))
    assert of_an_environment in said
    assert of_a_model not in said


def test_the_smallest_round_has_the_least_of_everything_and_never_more_than_asked():
    least = smallest(SEARCH)
    assert (least.num_worlds, least.held_out_worlds) == (64, 64)
    assert least.detector_updates == (150,)
    assert (least.posterior_updates, least.state_updates) == (150, 100)
    assert least.fit == FIT.least()
    work = Work(3, 200, 4, 2)
    assert PACE.round_s(least, work) < PACE.round_s(SEARCH, work)
    assert smallest(least) == least


def test_no_part_has_more_time_than_is_left(monkeypatch):
    now_s = [50.0]
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    whole = Budget(100.0)
    now_s[0] += 60
    assert [whole.part(s).seconds for s in (30, 50, np.inf, -1)] == pytest.approx([30, 40, 40, 0])
    assert [Budget().part(s).seconds for s in (30, np.inf)] == [30, np.inf]
    with pytest.raises(ValueError, match="NaN"):
        whole.part(np.nan)


def test_a_share_is_of_all_the_time_but_no_more_than_is_left(monkeypatch):
    now_s = [50.0]
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    reports = []
    whole = Budget(100.0, lambda *said: reports.append(said), span=(0.0, 0.5))
    assert whole.share(0.3).seconds == pytest.approx(30)
    now_s[0] += 60
    part = whole.share(0.3, (0.4, 0.6))
    assert part.seconds == pytest.approx(30)
    part.report("half of it", 0.5)
    assert reports == [("half of it", pytest.approx(0.25))]
    now_s[0] += 20
    assert whole.share(0.3).seconds == pytest.approx(20), "all that is left"
    assert part.seconds_left == pytest.approx(10), "from when it was taken"
    now_s[0] += 30
    assert whole.share(0.3).is_over
    assert Budget().share(0.3).seconds == math.inf
    assert Budget().share(0.3).is_endless
    with pytest.raises(ValueError, match="got NaN"):
        Budget(math.inf - math.inf)
    assert not whole.is_endless
