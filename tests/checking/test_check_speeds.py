"""Joints whose servos are sent speeds: what encoders say beside such commands."""

import mujoco
import numpy as np
import pytest

from simtune.checking.doubt import grouped
from simtune.checking.servos.commands import servos_of
from simtune.checking.servos.fit import delayed_by, filtered_by
from simtune.checking.servos.following import Watched
from simtune.checking.servos.look import look_at
from simtune.checking.servos.speeds import beside_speeds
from simtune.simulation.servos import joint_target, motors, velocity_servos
from simtune.tasks import load_task

STEP_S, STEPS = 0.03, 300
COUNT = 2 * np.pi / 1440

SCENE = """
<mujoco>
  <worldbody>
    <body>
      <joint name="wheel" axis="0 1 0" damping="0.001"/>
      <geom type="cylinder" size="0.03 0.01" mass="0.1"/>
      <body pos="0 0.1 0"><joint name="arm"/><geom size="0.02" mass="0.1"/></body>
    </body>
  </worldbody>
  <actuator>
    <velocity name="motor" joint="wheel" kv="0.01" gear="2"/>
    <motor name="push" joint="arm"/>
  </actuator>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.03

[[sensors]]
name = "places"
joints = ["wheel", "arm"]

[[sensors]]
name = "speeds"
joints = ["wheel"]
quantity = "velocity"

[[parameters]]
name = "strength"
kind = "gain"
objects = "motor"
"""


def commands(seed: int, ahead: float = 3.0) -> np.ndarray:
    """(T,) speeds of a robot's wheel: mostly ahead, each held for some time."""
    rng = np.random.default_rng(seed)
    both = np.repeat(np.random.default_rng(99).normal(size=STEPS // 15), 15)
    return ahead * both + np.repeat(4 * rng.normal(size=STEPS // 15), 15)


def angles(command: np.ndarray, scale: float = 0.9, count: float = COUNT) -> np.ndarray:
    """(T + 1,) of a wheel that lags by three steps, as its encoder counts them."""
    speed = scale * filtered_by(delayed_by(command, 1.0), 2.0)
    turned = np.append(0.0, np.cumsum(speed) * STEP_S)
    return count * np.round(turned / count)


def said_of(*joints: tuple[np.ndarray, np.ndarray]) -> list[str]:
    """What is said of joints with these commands and positions."""
    names = ("left", "right")
    raw = [Watched(n, "rad", [c], [m], STEP_S) for n, (c, m) in zip(names, joints, strict=False)]
    speeds = beside_speeds(raw)
    return grouped(doubt for its in speeds for doubt in look_at(its, speeds).doubts)


def test_speeds_and_commands_are_means_over_the_same_steps():
    command, read = np.array([0, 2, 2, 2, 2.0]), np.array([0, 0, 1, 2, 3, 4.0])
    (its,) = beside_speeds([Watched("wheel", "m", [command], [read], 0.5)])
    np.testing.assert_array_equal(its.measured[0], [np.nan, 1, 2, 2, 2, np.nan])
    np.testing.assert_array_equal(its.commands[0], [0.5, 1.5, 2, 2, 2])
    assert (its.unit, its.is_speed) == ("m/s", True)


def test_speeds_of_a_coarse_encoder_are_means_over_longer():
    """20 counts a turn: in one step it counts 0 or 1."""
    command = commands(0, ahead=0.0)
    raw = [
        Watched("wheel", "rad", [command], [angles(command, 1.0, 2 * np.pi / num)], STEP_S)
        for num in (1440, 20)
    ]
    speeds = [beside_speeds([its])[0] for its in raw]
    assert [np.isnan(its.measured[0]).sum() for its in speeds] == [2, 4]
    fine, coarse = map(look_at, speeds)
    assert coarse.doubts == fine.doubts == []
    # a delay of 1 step, a filter of 2, and half a step of a command that is interpolated
    assert [its.servo.lag_steps for its in (fine, coarse)] == pytest.approx([3.0, 3.0], abs=0.6)
    assert fine.play is None


def test_wheels_that_follow_leave_no_doubt():
    for scale in (0.5, 1.0, 1.5):
        assert said_of(*((c, angles(c, scale)) for c in (commands(1), commands(2)))) == []


@pytest.mark.parametrize(
    ("misread", "expected"),
    [
        (lambda read: -read, "left moves -0.8"),
        (lambda read: read / COUNT, "are its readings an encoder's counts? give the sensor a gain"),
        (np.rad2deg, 'are its readings degrees? give the sensor unit = "deg" (likewise right)'),
        (lambda read: np.gradient(read, STEP_S), 'velocities? give the sensor quantity = "veloc'),
        (lambda read: np.full_like(read, 3.0), "left reads 0 rad/s all the time, while it is"),
    ],
)
def test_faults_of_both_wheels(misread, expected):
    (said,) = said_of(*((c, misread(angles(c))) for c in (commands(1), commands(2))))
    assert expected in said
    assert said.endswith("(likewise right)")


def test_commands_in_turns_a_minute():
    rpm = 30 / np.pi
    (said,) = said_of(*((rpm * c, angles(c)) for c in (commands(1), commands(2))))
    assert "are the actions turns a minute? give [actions] gain = 0.1047" in said


def test_exchanged_wheels_of_a_robot_that_drives_ahead():
    left, right = commands(1, ahead=6.0), commands(2, ahead=6.0)
    read = angles(left), angles(right)
    assert abs(np.corrcoef(np.diff(read[0]), left)[0, 1]) > 0.4
    (said,) = said_of((left, read[1]), (right, read[0]))
    assert said.startswith("left follows right's command, its own with a correlation of 0.")
    assert said.endswith("are columns exchanged? (likewise right left's)")
    assert said_of((left, read[0]), (right, read[1])) == []


def test_a_velocity_sensor_in_turns_a_minute():
    command = commands(1)
    speed = np.append(filtered_by(command, 2.0), 0.0)
    joint = Watched("wheel", "rad/s", [command], [30 / np.pi * speed], STEP_S)
    (doubt,) = look_at(joint).doubts
    assert "are its readings turns a minute? give the sensor gain = 0.1047" in doubt.says
    assert look_at(joint._replace(measured=[speed])).doubts == []


def test_servos_of_speeds_in_a_model(tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    place, none, speed = servos_of(task.simulator(image_size=16), task.sensors)
    assert none is None, "a motor has no target"
    assert place == speed
    assert place is not None
    assert place.of_speed
    model = mujoco.MjModel.from_xml_string(SCENE)
    assert velocity_servos(model).tolist() == [True, False]
    # kv · control, through the gear, is kv · gear² · speed
    assert joint_target(model, 0) == pytest.approx((0.0, 0.5))


@pytest.mark.parametrize("every", [3, 5])
def test_an_encoder_that_is_read_in_every_few_rows_is_looked_at(every):
    some = []
    for seed in (1, 2):
        read = np.full(STEPS + 1, np.nan)
        read[::every] = angles(commands(seed))[::every]
        some.append((commands(seed), read))
    assert said_of(*some) == []
    (said,) = said_of(*((command, -read) for command, read in some))
    assert said.startswith("left moves -0.")


MOTORS = """
<mujoco>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 0 1" damping="{damping}"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""
BY_VOLTAGE = '<general joint="hinge" biastype="affine" gainprm=".005" biasprm="0 0 -.0002"/>'


@pytest.mark.parametrize(
    ("actuator", "damping", "is_servo"),
    [
        ('<velocity joint="hinge" kv=".01"/>', 0.005, True),
        ('<velocity joint="hinge" kv=".01"/>', 0.06, False),  # a seventh of what it is sent
        ('<velocity joint="hinge" kv=".01" gear="3"/>', 0.06, True),
        (BY_VOLTAGE, 1e-4, False),  # within a second
        ('<motor joint="hinge"/>', 1e-4, False),
    ],
)
def test_what_hardly_reaches_its_speed_is_a_motor(actuator, damping, is_servo):
    model = mujoco.MjModel.from_xml_string(MOTORS.format(actuator=actuator, damping=damping))
    assert velocity_servos(model).tolist() == [is_servo]
    assert motors(model).tolist() == [not is_servo]


def test_a_slow_wheel_that_is_counted_seldom_is_not_stuck():
    command = np.repeat([0.0, 0.5, 4.0, -4.0, 0.3, 0.0, 2.0, -2.0], STEPS // 8)
    assert said_of((command, angles(command, 1.0, 2 * np.pi / 12))) == []
