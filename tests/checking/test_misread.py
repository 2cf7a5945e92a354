"""A rotary pendulum, driven by a motor: mistakes in its recordings that short replays tell."""

import time
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from simtune.budget import Budget
from simtune.checking import expected_precision
from simtune.checking.mistakes.changes import ZERO, changes
from simtune.checking.mistakes.explained import Found, in_words
from simtune.checking.mistakes.misread import Trying, misread
from simtune.checking.mistakes.short_replays import ShortReplays
from simtune.checking.readings import look_at_servos
from simtune.fit import Readings
from simtune.real.observed import observed
from simtune.simulation import Simulator
from simtune.simulation.servos import motors
from simtune.tasks import load_task
from simtune.trajectory import Trajectory

STEP_S, STEPS, COUNT = 0.02, 150, 2 * np.pi / 2048
SCENE = """
<mujoco>
  <option timestep="0.005"><flag contact="disable"/></option>
  <worldbody>
    <body pos="0 0 .2">
      <joint name="arm" axis="0 0 1" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 0 -.08 0" size=".006" mass=".1"/>
      <body pos="0 -.08 0">
        <joint name="pendulum" axis="0 1 0" damping="1e-5"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.13" size=".006" mass="{mass}"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""
MOTOR = '<general name="motor" joint="arm" gainprm="{gain}" ctrlrange="-10 10"/>'
TUNE = """
model = "scene.xml"
control_timestep_s = 0.02

[[sensors]]
name = "encoders"
joints = ["arm", "pendulum"]

[[parameters]]
name = "damping"
kind = "damping"
objects = "arm"
"""


def seen_in(folder, actuator: str = MOTOR) -> tuple[Simulator, object]:
    """A simulator whose values are up to twice the truth, or half of it."""
    scene = SCENE.format(damping=2e-4, mass=0.024, actuator=actuator.format(gain=0.005))
    (folder / "scene.xml").write_text(scene)
    (folder / "tune.toml").write_text(TUNE)
    task = load_task(str(folder / "tune.toml"))
    return task.simulator(image_size=16), observed(task, None, is_simulated=False)


def recorded(episodes: int = 2) -> Readings:
    """What encoders count of a robot whose arm rubs more, and whose motor is weaker."""
    scene = SCENE.format(damping=4e-4, mass=0.03, actuator=MOTOR.format(gain=0.003))
    model = mujoco.MjModel.from_xml_string(scene)
    actions = np.zeros((episodes, STEPS, 1))
    values = np.zeros((episodes, STEPS + 1, 2))
    for episode in range(episodes):
        rng, data = np.random.default_rng(episode), mujoco.MjData(model)
        actions[episode, :, 0] = 4 * np.repeat(rng.normal(size=STEPS // 5), 5)
        for t in range(STEPS):
            data.ctrl[:] = actions[episode, max(t - 1, 0)]  # a step late
            mujoco.mj_step(model, data, 4)
            values[episode, t + 1] = COUNT * np.round(data.qpos / COUNT)
    return Readings(actions, values)


def changed(factor=(1.0, 1.0), shift=(0.0, 0.0), push: float = 1.0) -> Readings:
    right = recorded()
    return Readings(push * right.actions, right.values * factor + shift)


def trajectories(readings: Readings) -> list[Trajectory]:
    frames = np.zeros((STEPS + 1, 0, 0, 3), np.uint8)
    return [
        Trajectory(frames, actions.astype(np.float32), STEP_S, {"encoders": values})
        for actions, values in zip(readings.actions, readings.values, strict=True)
    ]


@pytest.fixture
def few_delays(monkeypatch):
    """Actions are a step late in `recorded`: longer delays would be tried, and take longest.

    They are where readings are right, and where a controller shakes the robot.
    """
    monkeypatch.setattr("simtune.checking.mistakes.short_replays._LATE_S", (0.0, STEP_S))


def test_right_readings_are_not_doubted_whatever_a_models_first_values(tmp_path):
    assert misread(recorded(), *seen_in(tmp_path)) == []


@pytest.mark.usefixtures("few_delays")
@pytest.mark.parametrize(
    ("mistake", "expected"),
    [
        ({"factor": (1, -1)}, "pendulum seems to be read with a reversed sign"),
        ({"factor": (180 / np.pi,) * 2}, 'sensor encoders seems to say degrees (unit = "deg")'),
        ({"shift": (0, np.pi)}, "the zero of pendulum seems to be "),
    ],
)
def test_one_mistake_is_told(tmp_path, mistake, expected):
    (said,) = misread(changed(**mistake), *seen_in(tmp_path))
    assert said.startswith(expected)
    assert ": then replays of 0.25 s end " in said


@dataclass
class Clock:
    """It goes on by a second with each replay of all pieces, at one delay; counts these."""

    now_s: float = 0.0
    whole: int = 0


@pytest.fixture
def clock(few_delays, monkeypatch) -> Clock:
    its, left = Clock(), ShortReplays._left

    def slow_left(replays, readings, num_pieces):
        its.now_s += num_pieces / replays.num_pieces
        its.whole += num_pieces == replays.num_pieces
        return left(replays, readings, num_pieces)

    monkeypatch.setattr(time, "monotonic", lambda: its.now_s)
    monkeypatch.setattr(ShortReplays, "_left", slow_left)
    return its


@pytest.mark.parametrize(
    ("mistake", "expected"),
    [
        ({"factor": (1, -1)}, "pendulum seems to be read with a reversed sign"),
        ({"push": -1.0}, "motor seems to push the other way"),
        ({}, None),
    ],
)
def test_on_a_slow_machine_a_few_pieces_tell_which_changes_are_tried(
    tmp_path, clock, mistake, expected
):
    """A change takes two seconds, and is tried with two delays; so are twelve other sizes."""
    simulator, seen = seen_in(tmp_path)
    said = misread(changed(**mistake), simulator, seen, 60.0)
    assert [its.startswith(expected) for its in said] == [True] * len(mistake)
    num = len(changes(simulator, seen))
    assert clock.whole < 2 * (1 + 12 + num)
    assert clock.now_s <= 60


@pytest.mark.parametrize(
    "most_s", [0.0, 30.0, 75.0, pytest.param(180.0, marks=pytest.mark.thorough)]
)
def test_two_mistakes_are_looked_for_as_long_as_there_is_time(tmp_path, clock, most_s):
    said = misread(changed(push=-1.0, shift=(0, np.pi)), *seen_in(tmp_path), most_s)
    assert clock.now_s <= max(2.0, most_s)
    assert bool(said) == (most_s > 50)
    assert ("motor seems" in "".join(said)) == (most_s > 130)


def test_no_size_is_tried_twice(tmp_path, clock):
    """The readings as they are, twelve other sizes, all changes, and no actions at all."""
    simulator, seen = seen_in(tmp_path)
    assert misread(recorded(), simulator, seen, 1000.0) == []
    assert clock.whole <= 2 * (1 + 12 + len(changes(simulator, seen)) + 1)


def test_a_caller_chooses_how_long(tmp_path, clock):
    simulator, seen = seen_in(tmp_path)
    episodes = trajectories(changed(push=-1.0))
    assert look_at_servos(episodes, simulator, seen, most_s=20.0).misread == []
    assert expected_precision.expected_precision(simulator, seen, episodes, 0, (), 20.0)


@pytest.mark.usefixtures("few_delays")
def test_actions_that_explain_nothing_of_what_moves_are_told(tmp_path):
    """As steps of a hand are, of which there may be as many as motors."""
    rng, times_s = np.random.default_rng(3), STEP_S * np.arange(STEPS + 1)
    swung = [[np.sin(a * times_s), np.cos(b * times_s)] for a, b in ((12, 16), (16, 12))]
    actions = np.repeat(rng.normal(size=(2, STEPS // 5, 1)), 5, 1)
    moved = Readings(actions, COUNT * np.round(np.swapaxes(swung, 1, 2) / COUNT))
    (said,) = misread(moved, *seen_in(tmp_path))
    assert said.startswith("replays of 0.25 s explain little of what was read, and no less without")
    at_rest = COUNT * np.round(rng.normal(scale=0.4, size=moved.values.shape))
    assert misread(Readings(actions, at_rest), *seen_in(tmp_path)) == []


@pytest.mark.usefixtures("few_delays")
def test_exchanged_columns_are_told(tmp_path):
    right = recorded()
    (said,) = misread(Readings(right.actions, right.values[..., ::-1]), *seen_in(tmp_path))
    assert said.startswith("the columns of arm and pendulum seem to be exchanged")


@pytest.mark.usefixtures("few_delays")
def test_a_zero_is_told_as_offset_that_mends_it(tmp_path):
    """5.1 rad are a turn, less 1.18; of an arm about a vertical axis no zero matters."""
    (said,) = misread(changed(shift=(3.8, 5.1)), *seen_in(tmp_path))
    assert said.startswith("the zero of pendulum seems to be -1.")
    zero = float(said.split("seems to be ")[1].split()[0])
    assert zero == pytest.approx(5.1 - 2 * np.pi, abs=0.15)
    assert misread(changed(shift=(0, -zero)), *seen_in(tmp_path)) != []
    assert misread(changed(shift=(3.8, 5.1 - zero)), *seen_in(tmp_path)) == []


@pytest.mark.usefixtures("few_delays")
def test_two_mistakes_are_told_together(tmp_path):
    (said,) = misread(changed(push=-1.0, shift=(0, np.pi)), *seen_in(tmp_path))
    assert said.startswith("the zero of pendulum seems to be ")
    assert ", and motor seems to push the other way: then replays of 0.25 s end" in said


def test_actions_and_columns_are_exchanged_by_hand(tmp_path):
    two = MOTOR + '<motor name="swing" joint="pendulum"/>'
    simulator, seen = seen_in(tmp_path, two)
    tried = {change.says.split(" seem")[0]: change for change in changes(simulator, seen)}
    readings = Readings(np.arange(6.0).reshape(1, 3, 2), np.arange(8.0).reshape(1, 4, 2))
    acted = tried["actions of motor and swing"].of(readings)
    np.testing.assert_array_equal(acted.actions[0], [[1, 0], [3, 2], [5, 4]])
    np.testing.assert_array_equal(acted.values, readings.values)
    read = tried["the columns of arm and pendulum"].of(readings)
    np.testing.assert_array_equal(read.values[0, :, 0], readings.values[0, :, 1])
    np.testing.assert_array_equal(read.actions, readings.actions)


def test_joints_that_servos_move_are_left_to_their_commands(tmp_path):
    servo = '<position name="motor" joint="arm" kp=".05" kv=".005"/>'
    simulator, seen = seen_in(tmp_path, servo)
    assert not any("arm" in said for said in misread(changed(push=-1.0), simulator, seen))
    assert motors(simulator.model).tolist() == [False]


@pytest.mark.usefixtures("few_delays")
def test_check_tells_it(tmp_path):
    (simulator, seen), episodes = seen_in(tmp_path), trajectories(changed(push=-1.0))
    (said,) = look_at_servos(episodes, simulator, seen).misread
    assert said.startswith("motor seems to push the other way")
    right = [replace(episode, actions=-episode.actions) for episode in episodes]
    assert look_at_servos(right, simulator, seen).misread == []


@pytest.mark.usefixtures("few_delays")
@pytest.mark.parametrize("steps", [1, 3, 8, 12])
def test_short_episodes_are_replayed_as_far_as_they_go(tmp_path, steps):
    right = recorded()
    few = Readings(right.actions[:, :steps], right.values[:, : steps + 1])
    misread(few, *seen_in(tmp_path))


def test_no_more_changes_are_tried_than_there_is_time_for(tmp_path):
    """A third of it for each of three mistakes."""
    tried = changes(*seen_in(tmp_path))

    def affordable(each_s: float):
        return Trying(Budget(60.0), 7 * each_s, each_s).affordable(tried)

    assert affordable(0.01) == tried
    some = affordable(1.5)
    assert 0 < len(some) < len(tried)
    assert not any(change.shift.any() for change in some)
    assert affordable(30.0) == some


@pytest.mark.usefixtures("few_delays")
def test_a_zero_after_a_reversed_sign_is_what_was_measured(tmp_path):
    """It reads −angle + .8, so .8 where the joint is at 0."""
    zero = f"the zero of {{0}} is {ZERO}"  # a name may have braces
    said = in_words({zero: Found(0.8, []), "{b}": Found(0.0, ["{b}", "c"])})
    assert said == "the zero of {0} is 0.80, and {b}, or c"
    both = {"b": Found(0.0, ["b", "c"]), "c": Found(0.0, ["c", "b"])}
    assert in_words(both) == "b, and c"
    (said,) = misread(changed(factor=(1, -1), shift=(0, 0.8)), *seen_in(tmp_path))
    zero = float(said.split("zero of pendulum seems to be ")[1].split()[0])
    assert zero == pytest.approx(0.8, abs=0.2)


@pytest.mark.usefixtures("few_delays")
@pytest.mark.parametrize("stuck", [[0], [0, 1]])
def test_an_encoder_that_reads_the_same_while_its_motor_is_told_to_push(tmp_path, stuck):
    right = recorded()
    values = right.values.copy()
    values[..., stuck] = 0.3
    (said,) = misread(Readings(right.actions, values), *seen_in(tmp_path))
    assert said.startswith("arm reads 0.3 rad all the time, while the actions of motor change: ")
    assert misread(Readings(0 * right.actions, values), *seen_in(tmp_path)) == []


BALANCED = """
<mujoco>
  <option timestep="0.005"><flag contact="disable"/></option>
  <worldbody>
    <body>
      <joint name="slide" type="slide" axis="1 0 0" damping=".1"/>
      <geom type="box" size=".1 .1 .05" mass="{mass}"/>
      <body>
        <joint name="hinge" axis="0 1 0" damping=".002"/>
        <geom type="capsule" fromto="0 0 0 0 0 .5" size=".02" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="slide" gear="10" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
RAIL = """
model = "scene.xml"
control_timestep_s = 0.02

[[sensors]]
name = "rail"
joints = ["slide"]
unit = "m"

[[sensors]]
name = "pole"
joints = ["hinge"]

[[parameters]]
name = "damping"
kind = "damping"
objects = "slide"
"""


def balanced(mass: float, late: int) -> Readings:
    """Of a cart-pole that a controller holds up, with actions that are late by these steps."""
    model = mujoco.MjModel.from_xml_string(BALANCED.format(mass=mass))
    actions, values = np.zeros((2, STEPS, 1)), np.zeros((2, STEPS + 1, 2))
    for episode in range(2):
        rng, data = np.random.default_rng(episode), mujoco.MjData(model)
        data.qpos[1] = 0.05 * rng.normal()
        values[episode, 0] = data.qpos
        for t, goal in enumerate(np.repeat(0.3 * rng.normal(size=STEPS // 30), 30)):
            away = 2.5 * (data.qpos[0] - goal) + 4 * data.qvel[0]
            push = (away + 40 * data.qpos[1] + 8 * data.qvel[1]) / 10
            actions[episode, t] = np.clip(push, -1, 1)
            data.ctrl[:] = actions[episode, max(t - late, 0)]
            mujoco.mj_step(model, data, 4)
            values[episode, t + 1] = data.qpos + 5e-4 * rng.normal(size=2)
    return Readings(actions, values)


@pytest.mark.parametrize("late", [0, 1])
def test_a_controller_that_holds_a_lighter_cart_is_no_mistake(tmp_path, late):
    """Whose motor seems weak, or that shakes to and fro with every few steps."""
    (tmp_path / "scene.xml").write_text(BALANCED.format(mass=1))
    (tmp_path / "tune.toml").write_text(RAIL)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    right = balanced(0.3, late)
    assert np.abs(right.values[..., 1]).max() < 0.5, "it is held up"
    assert misread(right, simulator, seen) == []
    its = balanced(1.0, late)
    (said,) = misread(Readings(-its.actions, its.values), simulator, seen)
    assert said.startswith("push seems to push the other way: ")
