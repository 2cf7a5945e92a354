"""Pictures that come late by a part of a step."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from keypoint_evidence import tracks_at
from test_fit import (  # noqa: F401
    CARTPOLE,
    MOVING,
    SPACE,
    observed_of,
    played,
    rough_states,
    simulator,
)

from simtune.before_after.videos import film_from
from simtune.fit import Lateness, Physics, states_in_late_pictures
from simtune.fit.fit_warnings import delay_warnings
from simtune.fit.lateness import late_unit, steps_late, steps_late_and_std
from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.observation import AllEvidence, JointReadings, ObservationModel
from simtune.simulation import Rollouts
from simtune.trajectory import Trajectory
from simtune.tuning.observing import Observing

SUBSTEPS = CARTPOLE.action_repeat
SCENE = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -4 0" xyaxes="1 0 0 0 0 1"/>
    <body name="box"><joint name="slide" type="slide"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor name="push" joint="slide"/></actuator>
</mujoco>
"""
TUNING = """model = "scene.xml"
control_timestep_s = 0.02
camera = "front"
[[sensors]]
name = "arm"
joints = ["slide"]
[[parameters]]
name = "mass"
kind = "mass"
objects = "box"
"""
DELAY = """
[[parameters]]
name = "delay"
kind = "delay"
objects = "push"
high = 0.1
"""


@pytest.fixture(scope="module")
def substeps(played) -> Rollouts:  # noqa: F811
    """The same world, with actions as long, observed at every step of physics."""
    keypoints, truth, rollouts = played
    actions, rng = np.repeat(rollouts.actions, SUBSTEPS, 1), np.random.default_rng(1)
    fine = replace(CARTPOLE, action_repeat=1).simulator(image_size=48)
    worlds = np.repeat(truth[None], len(actions), 0)
    return fine.roll_out(worlds, actions, rng, keypoints.observe, starts=rollouts.states[:, 0])


@pytest.mark.parametrize("steps", [-0.7, 0.0, 0.4])
@pytest.mark.parametrize("shares", [[0, 1], [0, 0.4, 1], [0, 0.25, 0.5, 0.75, 1]])
def test_what_moves_by_a_parabola_is_seen_exactly_where_it_was(steps, shares):
    lateness, count = Lateness(np.array([0, -1]), np.array(shares)), 5
    t = np.append((np.arange(count - 1.0)[:, None] + shares[:-1]).ravel(), count - 1)
    power = min(2, len(shares) - 1)  # straight, where there is nothing between steps
    there = np.stack([3 + 2 * t - t**power, t**3], -1)
    unit = np.full((1, 1, 1), late_unit(steps))
    seen = lateness.seen(there[None, None], unit)[0, 0]
    late = np.arange(count) - steps
    np.testing.assert_allclose(seen[:, 0], 3 + 2 * late - late**power, atol=1e-12)
    np.testing.assert_array_equal(seen[:, 1], np.arange(count) ** 3, "not of what is read")
    alone = there[:1]
    np.testing.assert_array_equal(lateness.seen(alone, np.ones(1)), alone, "a single frame")


def test_steps_and_unit_coordinates_are_inverse():
    assert steps_late(np.array(late_unit(0.3))) == pytest.approx(0.3)
    assert late_unit(0.0) == 0.5
    assert steps_late_and_std(np.array([0.5]), np.array([[0.04]])) == pytest.approx((0.0, 0.3))
    assert steps_late_and_std(np.zeros(0), np.zeros((0, 0))) == (0.0, 0.0)


def test_a_fit_predicts_where_a_late_film_has_things(played, substeps):  # noqa: F811
    """Read off where physics was some of its eight steps before, under the earlier action."""
    evidence = observed_of(played[2], 0.1, 0, np.random.default_rng(0)).evidence
    lateness = Lateness.of_evidence(evidence, SUBSTEPS)
    np.testing.assert_allclose(lateness.shares, [0, 0.25, 0.5, 0.75, 1])
    quarters = substeps.observed[:, :: SUBSTEPS // 4]
    for substep in (-3, -1, 1, 3):
        seen = lateness.seen(quarters, np.full((3, 1), late_unit(substep / SUBSTEPS)))[:, 1:-1]
        there = substeps.observed[:, SUBSTEPS - substep :: SUBSTEPS][:, : seen.shape[1]]
        # All but where the cart bumps into an end of its rail
        off, on_time = (
            np.quantile(np.abs(its - there), 0.98) for its in (seen, quarters[:, 4:-4:4])
        )
        assert off < 0.15 < 1 < on_time


def test_things_are_drawn_where_late_pictures_show_them(simulator, played, substeps):  # noqa: F811
    states = substeps.states[:, ::SUBSTEPS]
    np.testing.assert_array_equal(states_in_late_pictures(simulator, states, 0.0), states)
    for substep in (-3, 3):
        shown = states_in_late_pictures(simulator, states, substep / SUBSTEPS)[:, 1:-1, 1:3]
        there = substeps.states[:, SUBSTEPS - substep :: SUBSTEPS, 1:3][:, : shown.shape[1]]
        off, on_time = (np.abs(its - there).max() for its in (shown, states[:, 1:-1, 1:3]))
        assert off < 0.1 * on_time


def test_a_film_of_the_simulator_is_as_late_as_the_pictures(simulator, played, monkeypatch):  # noqa: F811
    """By the same rule as in a fit: quaternions do not lie on straight lines."""
    _, truth, rollouts = played
    drawn, blank = list[np.ndarray](), np.zeros((len(rollouts.states[0]), 48, 48, 3), np.uint8)
    monkeypatch.setattr(simulator, "render", lambda states, _: drawn.append(states) or blank)
    real = Trajectory(blank, rollouts.actions[0].astype(np.float32), simulator.step_s)
    for late_steps in (0.0, 0.4):
        film_from(simulator, real, truth, rollouts.states[0, 0], late_steps)
    on_time, late = drawn
    np.testing.assert_array_equal(late, states_in_late_pictures(simulator, on_time, 0.4))


@pytest.mark.thorough
def test_parameters_of_a_late_film_are_found_and_how_late_it_is(simulator, played, substeps):  # noqa: F811
    keypoints, truth, rollouts = played
    rng, late = np.random.default_rng(2), 2
    at = np.maximum(np.arange(0, substeps.observed.shape[1], SUBSTEPS) - late, 0)
    observed = observed_of(replace(rollouts, observed=substeps.observed[:, at]), 0.2, 0.0, rng)
    start = truth.copy()
    start[MOVING] *= [0.8, 1.25]
    physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
    guesses, config = np.array([0.1, 0.1, 0.5, 0.5]), ShootingConfig().where_pictures_are_late()
    off = []
    for lateness in (None, Lateness.of_evidence(observed.evidence, SUBSTEPS)):
        shooting = Shooting(physics, guesses, MOVING, config, lateness)
        found = shooting.fit(observed, rough_states(rollouts, rng), start)
        off.append(np.abs(found.unit - SPACE.to_unit(truth)[MOVING]).max())
        if lateness:
            ((steps, std),) = found.late.values()
            assert abs(steps - late / SUBSTEPS) < 0.08
            assert 0 < std < 0.05
        else:
            assert found.late == {}
    assert off[1] < 0.5 * off[0]


@pytest.mark.thorough
def test_readings_are_late_by_a_time_of_their_own(simulator, played, substeps):  # noqa: F811
    """A camera adds to what late actions do to both: here half of its lateness."""
    keypoints, truth, rollouts = played
    rng, late = np.random.default_rng(3), {"pictures": 4, "readings": 2}  # substeps
    all_at = np.arange(0, substeps.observed.shape[1], SUBSTEPS)
    at = {kind: np.maximum(all_at - its, 0) for kind, its in late.items()}
    filmed = replace(rollouts, observed=substeps.observed[:, at["pictures"]])
    observed = observed_of(filmed, 0.2, 0.0, rng)
    carts = substeps.states[:, at["readings"], 1:2]
    read = JointReadings.of("cart", "m", carts + 0.002 * rng.normal(size=carts.shape), 0.002)
    evidence = AllEvidence((*observed.evidence.parts, read))
    observed = replace(observed, evidence=evidence)
    start = truth.copy()
    start[MOVING] *= [0.8, 1.25]

    def see(batch) -> np.ndarray:
        return np.concatenate([keypoints.observe(batch), batch.qpos[:, :1]], 1)

    physics = Physics(simulator, see, rollouts.states[0, 0])
    guesses, config = np.array([0.1, 0.1, 0.5, 0.5]), ShootingConfig().where_pictures_are_late()
    lateness = Lateness.of_evidence(evidence, SUBSTEPS)
    assert lateness.kinds == ("pictures", "readings")
    shooting = Shooting(physics, guesses, MOVING, config, lateness)
    found = shooting.fit(observed, rough_states(rollouts, rng), start)
    for kind, (steps, std) in found.late.items():
        assert abs(steps - late[kind] / SUBSTEPS) < 0.08
        assert 0 < std < 0.05
    assert np.abs(found.unit - SPACE.to_unit(truth)[MOVING]).max() < 0.02


def test_what_a_camera_adds_is_told_beside_readings_on_time(played):  # noqa: F811
    """Of a declared delay they tell all themselves."""
    tracks = observed_of(played[2], 0.1, 0, np.random.default_rng(0)).evidence.parts
    read = JointReadings.of("cart", "m", played[2].states[..., 1:2], 0.001)
    evidence = AllEvidence((read, *tracks))
    both, pictures = (
        Lateness.of_evidence(evidence, SUBSTEPS, kinds)
        for kinds in (("pictures", "readings"), ["pictures"])
    )
    assert (both.kinds, pictures.kinds) == (("pictures", "readings"), ("pictures",))
    num = len(tracks[0].scale)
    assert both.kind.tolist() == [1] + num * [0]
    assert pictures.kind.tolist() == [-1] + num * [0]
    for lateness in (both, pictures):
        only = lateness.only("pictures")
        assert (only.kinds, only.kind.tolist()) == (("pictures",), num * [0])


@pytest.mark.parametrize(("std_s", "said"), [(0.0123, "12"), (0.0096, "9.6"), (0.0099999, "10")])
def test_how_sure_a_lateness_is_has_no_power_of_ten(std_s: float, said: str):
    (warning,) = delay_warnings({"readings": (0.09, std_s)}, 0, step_s=0.2)
    assert f"seem to come 90 ms later than the recordings say (± {said} ms);" in warning


def test_a_delay_of_which_actions_and_readings_have_a_part_is_told_as_a_sum():
    """Not as two faults, one late and one early."""
    (said,) = delay_warnings({"readings": (-0.003, 0.0003)}, 1, step_s=0.02)
    assert said == (
        "What an action does shows in readings 17 ms later than the recordings say (± 0.3 ms); "
        "the estimates allow for it."
    )
    both = {"pictures": (0.01, 0.0003), "readings": (0.0, 0.0003)}
    action, picture = delay_warnings(both, 1, step_s=0.02)
    assert action.startswith("The actions seem to take effect 1 step later")
    assert picture.startswith("What an action does shows in pictures 30 ms later")
    for late, late_s, begins in (
        (0, 0.003, ["The readings seem to come 3 ms later"]),
        (1, 0.0, ["The actions seem to take effect 1 step later"]),
        (0, 0.0, []),
    ):
        told = delay_warnings({"readings": (late_s, 0.0003)}, late, step_s=0.02)
        assert [its[: len(begin)] for its, begin in zip(told, begins, strict=True)] == begins


def test_a_delay_at_the_end_of_its_range_is_no_sum():
    action, late = delay_warnings({"pictures": (0.015, 0.0003)}, 1, 0.02)
    assert action.startswith("The actions seem to take effect 1 step later")
    assert late.startswith("Pictures come 15 ms late, the most that is fitted")


@pytest.mark.parametrize(
    ("delay", "sensors", "late"),
    [
        ("", True, ("pictures", "readings")),
        ("", False, ("pictures",)),
        (DELAY, True, ("pictures",)),
        (DELAY, False, None),  # nothing tells one from the other
    ],
)
def test_what_may_be_late_beside_a_declared_delay(load, delay, sensors, late):
    task = load(TUNING + delay)
    observation = ObservationModel.of_reality(task.sensors if sensors else ())
    context = SimpleNamespace(observation=observation, simulator=task.simulator(image_size=16))
    observing = Observing(context, *[None] * 2)
    pixels = tracks_at(np.zeros((1, 3, 1, 2)), 0.3, 16)
    read = JointReadings.of("arm", "m", np.zeros((1, 3, 1)), 0.001)
    found = observing._lateness(AllEvidence((pixels, read) if sensors else (pixels,)))
    assert (found and found.kinds) == late
