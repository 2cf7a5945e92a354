"""What readings tell before videos are looked at, and how the two are put together."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from simtune.fit import JointMotion, PointEstimate
from simtune.parameters import ParameterSpace, dynamics
from simtune.randomization import Distribution
from simtune.real.observed import observed
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import Estimate
from simtune.tuning.readings.agreement import BestDescent
from simtune.tuning.readings.estimate import ReadingsEstimate, search_of
from simtune.tuning.readings.verdict import ReadingsResult
from simtune.tuning.search import SearchContext
from simtune.vision.keypoints import find_keypoints

SPACE = ParameterSpace(
    [dynamics(n, "body_mass", (n,), nominal=1.0, unit="kg") for n in ("servo", "box")]
)
LEANING = """
model = "scene.xml"
control_timestep_s = 0.02

[initial_state]
kind = "distribution"

[initial_state.joints]
lean = { position = [-0.5, 0.5] }

[[sensors]]
name = "angle"
joints = "elbow"

[[parameters]]
name = "mass"
kind = "mass"
objects = "arm"
"""
FIRST = Distribution.first(SPACE, SPACE.nominal)


def estimate(low: tuple[float, float], high: tuple[float, float], *verdicts, **others) -> Estimate:
    mean = np.sqrt(np.multiply(low, high))
    curves = {name: (np.array([low[i], high[i]]), np.array([1.0, 0.0])) for i, name in
              enumerate(SPACE.names)}  # fmt: skip
    return Estimate(mean, np.array(low), np.array(high), list(verdicts), curves, **others)


READ = estimate(
    (1.9, 0.5), (2.1, 2.0), "identified", "not identifiable",
    correlation=np.array([[1.0, 0.9], [0.9, 1.0]]), latency_steps=2,
)  # fmt: skip
SEEN = FIRST.with_interval(READ.mean, np.array([1.8, 0.5]), np.array([2.2, 2.0]))


def by_fit(
    estimate: Estimate,
    is_trusted: bool,
    joints: JointMotion | None = None,
    is_in_time: bool = True,
) -> ReadingsEstimate:
    found = cast(BestDescent, None)  # is not asked for
    fit = ReadingsResult(estimate, SEEN, is_trusted, is_in_time, found, np.zeros(1))
    return ReadingsEstimate(fit, FIRST, joints)


def test_what_readings_identify_is_held_where_they_have_it():
    by_readings = by_fit(READ, is_trusted=True)
    assert by_readings.is_held.tolist() == [True, False]
    start = by_readings.start(PointEstimate(np.array([1.0, 1.5]), np.array([0.2, 0.3])))
    assert start.parameters == pytest.approx([READ.mean[0], 1.5])
    width = SPACE.to_unit(READ.high) - SPACE.to_unit(READ.low)
    assert start.std == pytest.approx([width[0] / 3.29, 0.3])
    narrowed = by_readings.narrowed(FIRST)
    assert (narrowed.low[0], narrowed.high[0]) == (1.8, 2.2)
    assert (narrowed.low[1], narrowed.high[1]) == (FIRST.low[1], FIRST.high[1])


def test_each_parameter_is_as_the_better_of_both_says():
    both = estimate((1.0, 0.9), (3.0, 1.1), "weak", "identified", correlation=np.eye(2))
    mixed = by_fit(READ, is_trusted=True).combined_with(both)
    assert mixed.verdict == ["identified", "identified"]
    assert mixed.mean == pytest.approx([READ.mean[0], both.mean[1]])
    assert (mixed.low[0], mixed.low[1]) == (1.9, 0.9)
    assert mixed.curves["servo"] is READ.curves["servo"]
    assert mixed.curves["box"] is both.curves["box"]
    assert mixed.correlation is not None
    # Of errors of different fits nothing is known
    assert mixed.correlation == pytest.approx(np.eye(2))
    # What both found late adds up: the fit looked at actions that were late already
    assert mixed.latency_steps == 2


def test_what_readings_and_videos_contradict_each_other_on_covers_both_and_is_told():
    read = replace(READ, verdict=["weak", "weak"])
    both = estimate((2.5, 0.9), (2.6, 1.1), "identified", "identified")
    mixed = by_fit(read, is_trusted=True).combined_with(both)
    assert mixed.verdict == ["weak", "identified"]
    assert (mixed.low.tolist(), mixed.high.tolist()) == ([1.9, 0.9], [2.6, 1.1])
    at, above = mixed.curves["servo"]
    assert np.interp([1.9, 2.3, 2.6], at, above) == pytest.approx([1.0, 0.5, 0.0])
    (warning,) = mixed.warnings
    assert "contradict each other on servo: [1.9, 2.1] by readings alone, [2.5, 2.6]" in warning
    # A wide interval that ends beside a narrow one is no contradiction: it misses once in ten times
    wide = estimate((2.15, 0.9), (6.0, 1.1), "weak", "identified")
    assert by_fit(read, is_trusted=True).combined_with(wide).warnings == []
    # Where readings have no say, they contradict nothing
    assert by_fit(read, is_trusted=False).combined_with(both).low[0] == 2.5


def test_an_interval_that_covers_two_far_apart_tells_no_more_than_its_width():
    """Of the first range, 1/3 to 3, such an interval is nearly all."""
    read = estimate((0.38, 0.9), (0.42, 1.1), "identified", "identified")
    both = estimate((2.8, 0.9), (3.0, 1.1), "identified", "identified")
    mixed = by_fit(read, is_trusted=True).combined_with(both)
    assert (mixed.low[0], mixed.high[0]) == (0.38, 3.0)
    assert mixed.verdict == ["not identifiable", "identified"]


OF_FILM = "The joint readings alone are explained"


@pytest.mark.parametrize(
    ("unexplained", "is_trusted", "verdict", "is_told"),
    [
        ("nothing", True, "identified", False),
        ("film", True, "identified", True),
        ("model", True, "weak", False),
        ("film", False, "weak", False),  # used, since all but loose objects is read
    ],
)
def test_beside_videos_that_nothing_explains_readings_stand_only_if_the_film_may_be_wrong(
    unexplained, is_trusted, verdict, is_told
):
    joints = None if is_trusted else cast(JointMotion, object())
    both = estimate((1.0, 0.9), (3.0, 1.1), "weak", "weak", warnings=["No setting"])
    by_readings = by_fit(READ, is_trusted=is_trusted, joints=joints)
    mixed = by_readings.combined_with(both, unexplained)
    assert mixed.mean[0] == pytest.approx(READ.mean[0])
    assert mixed.verdict == [verdict, "weak"]
    assert mixed.warnings[0] == "No setting"
    told = [warning for warning in mixed.warnings if warning.startswith(OF_FILM)]
    assert ["what readings tell of servo stands" in warning for warning in told] == [True] * is_told


def test_warnings_of_readings_that_are_used_stay_where_videos_know_every_parameter_better():
    read = estimate((0.5, 0.5), (2.0, 2.0), "weak", "weak", warnings=["found once"])
    both = estimate((0.9, 0.9), (1.1, 1.1), "identified", "identified", warnings=["seen"])
    joints = cast(JointMotion, object())
    mixed = by_fit(read, is_trusted=False, joints=joints).combined_with(both)
    assert mixed.mean == pytest.approx(both.mean)
    assert mixed.warnings == ["found once", "seen"]


def test_an_interval_that_is_cut_off_at_a_bound_is_no_narrower_knowledge():
    """Readings that end at a bound, 1.0 ± .1 of its range, and .76 ± .06 with videos."""
    ends = [SPACE.from_unit(np.full(2, at)) for at in (1 - 0.165, 1.0, 0.76 - 0.1, 0.76 + 0.1)]
    low, high, video_low, video_high = ends
    read = replace(READ, mean=high, low=low, high=high, verdict=["weak", "weak"])
    both = replace(
        estimate(tuple(video_low), tuple(video_high), "weak", "weak"),
        mean=SPACE.from_unit(np.full(2, 0.76)),
    )
    by_readings = by_fit(read, is_trusted=True, joints=cast(JointMotion, object()))
    held = by_readings.start(PointEstimate(SPACE.nominal, np.full(2, 0.3)))
    np.testing.assert_allclose(held.std, 0.165 / 1.645, rtol=1e-3)
    mixed = by_readings.combined_with(both)
    np.testing.assert_allclose(mixed.mean, both.mean)  # which is the narrower one
    assert mixed.warnings == []


def test_without_a_fit_to_videos_errors_that_readings_know_still_go_together():
    both = estimate((1.0, 0.4), (3.0, 2.1), "weak", "weak")
    mixed = by_fit(READ, is_trusted=True).combined_with(both)
    assert mixed.mean == pytest.approx(READ.mean)
    assert mixed.correlation == pytest.approx(READ.correlation)
    assert mixed.correlations == {"servo, box": 0.9}


def test_readings_that_no_simulator_explains_twice_have_no_say():
    by_readings = by_fit(READ, is_trusted=False)
    both = estimate((1.0, 0.9), (3.0, 1.1), "weak", "identified")
    assert not by_readings.is_held.any()
    assert by_readings.latency_steps == 0
    mixed = by_readings.combined_with(both)
    assert mixed.mean == pytest.approx(both.mean)
    assert mixed.verdict == both.verdict


def test_a_robots_motion_is_read_even_if_no_second_fit_agreed():
    """Where all but loose objects is read. What one fit found is weak, and is said to be one's."""
    joints = cast(JointMotion, object())
    once = replace(READ, verdict=["weak", "not identifiable"], warnings=["found once"])
    by_readings = by_fit(once, is_trusted=False, joints=joints)
    assert by_readings.joints is joints
    assert by_readings.is_held.tolist() == [True, False]
    assert by_readings.latency_steps == 2
    both = estimate((1.0, 0.9), (3.0, 1.1), "not identifiable", "identified", warnings=["seen"])
    mixed = by_readings.combined_with(both)
    assert mixed.mean == pytest.approx([READ.mean[0], both.mean[1]])
    assert mixed.verdict == ["weak", "identified"]
    assert mixed.warnings == ["found once", "seen"]
    late = by_fit(once, is_trusted=False, joints=joints, is_in_time=False)
    assert not late.is_held.any()
    assert late.combined_with(both).mean == pytest.approx(both.mean)


def test_actions_and_readings_are_taken_when_it_was_so():
    frames, read = np.zeros((5, 0, 0, 3), np.uint8), {"arm": np.square(np.arange(5.0))[:, None]}
    real = Trajectory(frames, np.arange(4.0)[:, None], 0.1, readings=read)
    by_readings = by_fit(replace(READ, readings_late_s=(0.03, 0.001)), is_trusted=True)
    (late,) = by_readings.without_delay([real])
    assert late.actions[:, 0].tolist() == [0, 0, 0, 1]
    assert late.readings["arm"][:4, 0] == pytest.approx(np.square([0.3, 1.3, 2.3, 3.3]))
    assert np.isnan(late.readings["arm"][4, 0])
    both = estimate((1.0, 0.9), (3.0, 1.1), "weak", "identified")
    assert by_readings.combined_with(both).readings_late_s == (0.03, 0.001)
    rest = replace(both, readings_late_s=(0.004, 0.0))  # by windows, in which readings count, too
    assert by_readings.combined_with(rest).readings_late_s == pytest.approx((0.034, 0.001))
    # Readings may tell how late actions are, and no parameter well
    weak = by_fit(replace(READ, verdict=["weak", "weak"]), is_trusted=True)
    assert not weak.is_held.any()
    assert weak.without_delay([real])[0].actions[:, 0].tolist() == [0, 0, 0, 1]
    assert by_fit(READ, is_trusted=False).without_delay([real])[0] is real


def test_what_readings_tell_goes_with_their_offsets_and_warnings():
    read = replace(READ, offsets={"arm": 0.05}, warnings=["at a bound", "late"])
    both = estimate(
        (1.0, 0.9), (3.0, 1.1), "weak", "identified", offsets={"arm": 0.02}, warnings=["late"]
    )
    mixed = by_fit(read, is_trusted=True).combined_with(both)
    assert mixed.offsets == {"arm": 0.05}
    assert mixed.warnings == ["at a bound", "late"]
    alone = by_fit(read, is_trusted=False).combined_with(both)
    unused = "Joint readings alone had no say in the estimates: at a bound"
    assert (alone.offsets, alone.warnings) == ({"arm": 0.02}, [unused, "late"])


@pytest.mark.parametrize(("arm", "is_fitted"), [("0 0 0", True), (".2 0 0", False)])
def test_beside_video_readings_are_fitted_first_unless_they_show_where_a_base_begins(
    tmp_path, arm, is_fitted
):
    """A trunk leans as it likes; an arm that hangs to one side turns as the trunk leans."""
    scene = f"""<mujoco><worldbody><body>
      <joint name="lean" axis="1 0 0" stiffness="5"/><geom size=".1" mass="2"/>
      <body name="arm" pos="0 0 .2"><joint name="elbow" axis="0 0 1" damping=".1"/>
        <geom pos="{arm}" size=".05" mass=".2"/></body>
    </body></worldbody><actuator><position name="elbow" joint="elbow" kp="5"/></actuator></mujoco>
    """
    (tmp_path / "scene.xml").write_text(scene)
    (tmp_path / "tune.toml").write_text(LEANING)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, space = task.simulator(image_size=16), task.parameters
    first = Distribution.first(space, space.nominal)
    context = SearchContext(
        simulator=simulator,
        keypoints=find_keypoints(simulator, first, 0),
        start=space.nominal,
        observation=observed(task, None, is_simulated=False),
        seed=0,
    )
    rests = {"angle": np.zeros((31, 1))}
    frames, actions = np.zeros((31, 0, 0, 3), np.uint8), np.zeros((30, 1), np.float32)
    search = search_of(context, [Trajectory(frames, actions, 0.02, rests)] * 2)
    assert (search is not None) == is_fitted
