"""Episodes that diverge from where they begin, and what `check` says of them."""

from pathlib import Path

import numpy as np
import pytest

from simtune.budget import Budget
from simtune.checking.check import check
from simtune.checking.sensitive_starts import growth_warnings
from simtune.checking.sensitivity.reading_changes import ReadingChanges, ReplayedReadings
from simtune.config import CheckConfig
from simtune.fit import OpenLoopReplay, Readings
from simtune.fit.readings.growth import follow, growth
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments
from simtune.real.observed import observed
from simtune.tasks import Task, load_task

RATE = np.sqrt(9.81)  # 1/s, of a pendulum of 1 m that stands on its tip: θ'' = RATE² θ
SCENE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="pole">
      <joint name="tip" axis="0 1 0"/>
      <inertial pos="0 0 {height}" mass="1" diaginertia="1e-6 1e-6 1e-6"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="tip"/></actuator>
  <keyframe><key name="rest" qpos="0"/></keyframe>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.05
episode_steps = {steps}
initial_state = {{kind = "keyframe", keyframe = "rest"}}

[[sensors]]
name = "angle"
joints = "tip"
noise = 0.001

[[parameters]]
name = "mass"
kind = "mass"
objects = "pole"
"""


def pole(folder: Path, height: float, steps: int) -> Task:
    (folder / "scene.xml").write_text(SCENE.format(height=height))
    (folder / "tune.toml").write_text(TUNE.format(steps=steps))
    return load_task(str(folder / "tune.toml"))


@pytest.mark.parametrize(("height", "grows"), [(1.0, np.cosh), (-1.0, lambda _: 1.0)])
def test_an_error_of_a_start_grows_as_the_equation_of_motion_says(tmp_path, height, grows):
    """θ(t) = θ₀ cosh(RATE t) on its tip, and θ₀ cos(RATE t) as it hangs."""
    task, steps = pole(tmp_path, height, 20), 20
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    still = np.zeros((2, steps, 1))
    replayed = ReplayedReadings(simulator, seen, task.parameters.nominal, still)
    growth = replayed.changes(task.parameters.nominal[None], np.array([1e-3])).growth
    np.testing.assert_allclose(growth, grows(RATE * steps * 0.05), rtol=0.02)


def test_parts_that_there_is_no_time_for_are_assumed_to_tell_as_much(tmp_path):
    task, still = pole(tmp_path, -1.0, 20), np.zeros((2, 20, 1))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    nominal, given = (
        task.parameters.nominal,
        (1.2 * task.parameters.nominal[None], np.array([1e-3])),
    )
    readings = Readings(still, np.full((2, 21, 1), 0.3))

    def found(budget: Budget) -> ReadingChanges:
        replays = ReplayedReadings(simulator, seen, nominal, still, readings, 0, budget)
        return replays.changes(*given)

    whole, few = found(Budget()), found(Budget(1e-9))
    assert whole.left_out == ()
    assert few.left_out[-1].startswith("there was time to ask 1 of 2 parts of episodes")
    np.testing.assert_allclose(few.information, whole.information, rtol=0.05)


@pytest.mark.filterwarnings("error")
def test_what_flies_away_has_grown_without_end_and_no_overflow_is_told_of(tmp_path, monkeypatch):
    task = pole(tmp_path, 1.0, 20)
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
    unit = task.parameters.to_unit(task.parameters.nominal)
    upright = Readings(np.zeros((1, 20, 1)), np.zeros((1, 21, 1)))
    whole = loop.states_of(upright, unit).cut(Segments.evenly(upright))

    def fly(_, stretches, states, units):
        return 1e307 * np.sign(states[:, :, None, :1]), None

    monkeypatch.setattr(OpenLoopReplay, "play", fly)
    assert growth(loop, whole, unit)[0].max() == np.inf


@pytest.mark.parametrize("push", [50.0, -50.0])
def test_a_joint_that_turns_on_and_on_is_not_astray(tmp_path, push):
    """At 50 rad/s² on average, after 8 s at 1600 rad."""
    task = pole(tmp_path, 1.0, 200)
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    nominal = task.parameters.nominal
    replayed = ReplayedReadings(simulator, seen, nominal, np.full((1, 200, 1), push))
    changes = replayed.changes(1.2 * nominal[None], np.array([1e-3]))
    assert changes.rms[0, 0] > 100, "a heavier one turns less"


@pytest.mark.parametrize(("steps", "is_warned_of"), [(14, False), (60, True)])
def test_check_warns_of_what_cannot_be_followed(tmp_path, steps, is_warned_of):
    pole(tmp_path, 1.0, steps)
    warnings = check(CheckConfig(task=str(tmp_path / "tune.toml"), episodes=2))["warnings"]
    found = [warning for warning in warnings if "an error of a first reading grows" in warning]
    assert len(found) == is_warned_of
    if found:
        assert "in 2 of 2 episodes replayed (episode 0, episode 1)" in found[0]


@pytest.mark.parametrize(
    ("height", "segments"), [(1.0, [(0, 19), (19, 19), (38, 19)]), (-1.0, [(0, 60)])]
)
def test_an_episode_is_followed_while_errors_grow_less_than_ten_times(tmp_path, height, segments):
    """cosh(RATE t) is 10 after .956 s, between steps 19 and 20."""
    task = pole(tmp_path, height, 60)
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
    upright = Readings(np.zeros((2, 60, 1)), np.zeros((2, 61, 1)))
    unit = task.parameters.to_unit(task.parameters.nominal)
    found, _ = follow(loop, loop.states_of(upright, unit, np.zeros(1)), unit)
    each = list(zip(found.begin.tolist(), found.steps.tolist(), strict=True))
    assert each == 2 * segments
    assert found.episode.tolist() == np.repeat([0, 1], len(segments)).tolist()


def test_all_of_a_long_episode_is_followed(tmp_path):
    steps = 20 * 19
    task = pole(tmp_path, 1.0, steps)
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
    upright = Readings(np.zeros((1, steps, 1)), np.zeros((1, steps + 1, 1)))
    unit = task.parameters.to_unit(task.parameters.nominal)
    found, _ = follow(loop, loop.states_of(upright, unit, np.zeros(1)), unit)
    assert found.steps.tolist() == 20 * [19]


def test_few_of_many_episodes_are_named():
    growth = np.array([1.0, 150.8, np.nan, 2.0])
    (warning,) = growth_warnings(growth, ["a", "b", "c", "d", "e"])
    assert warning.startswith("in 1 of 4 episodes replayed (b) an error of a first reading grows ")
    assert "up to 151 times" in warning
    assert growth_warnings(np.array([9.0, np.nan]), ["a", "b"]) == []


def test_what_is_unstable_open_loop_is_told_and_no_contact_where_nothing_touches():
    growth, names = np.array([17.0]), ["a"]
    (unknown,) = growth_warnings(growth, names)
    assert "(a contact, a fall, what swings freely, such as a load on a cable, or what" in unknown
    (nothing,) = growth_warnings(growth, names, [])
    assert "contact" not in nothing
    assert "it is unstable open loop" in nothing
    assert "touch" not in nothing
