"""Bases that no sensor measures: how fast they begin, and a robot that balances on wheels."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.budget import Budget
from simtune.checking.mistakes.misread import misread
from simtune.checking.mistakes.short_replays import ShortReplays
from simtune.fit import Guess, OpenLoopReplay, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.lateness import late_unit
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.segments import Segments
from simtune.observation import finds_offset
from simtune.real.observed import observed
from simtune.tasks import load_task

STEPS, STEP_S, RADIUS = 100, 0.02, 0.05
X, Z, PITCH, LEFT, RIGHT = range(5)
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="trunk" pos="0 0 .05">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="pitch" axis="0 1 0"/>
      <geom type="box" size=".03 .06 .08" pos="0 0 .08" mass="{mass}" contype="0" conaffinity="0"/>
      <body pos="0 .08 0"><joint name="left" axis="0 1 0" damping=".001" armature="2e-4"/>
        <geom type="cylinder" size=".05 .01" euler="90 0 0" mass=".08"/></body>
      <body pos="0 -.08 0"><joint name="right" axis="0 1 0" damping=".001" armature="2e-4"/>
        <geom type="cylinder" size=".05 .01" euler="90 0 0" mass=".08"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left" gear="{gear}"/><motor name="right" joint="right" gear="{gear}"/>
  </actuator>
  <keyframe><key name="stand" qpos="0 0 0 0 0"/></keyframe>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.02
initial_state = {kind = "keyframe", keyframe = "stand"}

[[sensors]]
name = "imu"
joints = "pitch"

[[sensors]]
name = "gyroscope"
joints = "pitch"
quantity = "velocity"

[[sensors]]
name = "wheels"
joints = ["left", "right"]

[[parameters]]
name = "mass"
kind = "mass"
objects = "trunk"

[[parameters]]
name = "gain"
kind = "gain"
objects = ["left", "right"]
"""
TRUTH = {"mass": 0.45, "gear": 0.4}


def loop_in(folder: Path) -> OpenLoopReplay:
    task = load_task(str(folder / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    return set_up_loop(simulator, seen, task.parameters.nominal)


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> OpenLoopReplay:
    folder = tmp_path_factory.mktemp("balancing")
    (folder / "scene.xml").write_text(SCENE.format(mass=0.6, gear=0.35))
    (folder / "tune.toml").write_text(TUNE)
    return loop_in(folder)


@pytest.fixture(scope="module")
def driven() -> tuple[Readings, np.ndarray]:
    """Readings of two episodes that begin while a controller drives, and how fast the base was."""
    model = mujoco.MjModel.from_xml_string(SCENE.format(**TRUTH))
    actions, values = np.zeros((2, STEPS, 2)), np.zeros((2, STEPS + 1, 4))
    speeds = np.zeros((2, STEPS + 1))
    for episode in range(2):
        rng, data = np.random.default_rng(episode), mujoco.MjData(model)
        for t in range(-50, STEPS + 1):
            pitch, turning, speed = data.qpos[PITCH], data.qvel[PITCH], data.qvel[X]
            if t >= 0:
                noise = rng.normal(size=4) * [5e-4, 5e-3, 5e-4, 5e-4]
                values[episode, t] = noise + np.array([pitch, turning, *data.qpos[[LEFT, RIGHT]]])
                speeds[episode, t] = speed
            goal = 0.8 * np.sin(0.1 * t + episode)
            lean = pitch - np.clip(0.22 * (goal - speed), -0.25, 0.25)
            push = (0.8 * lean + 0.13 * turning) / (2 * TRUTH["gear"]) + 0.02 * rng.normal(size=2)
            if 0 <= t < STEPS:
                actions[episode, t] = push
            data.ctrl[:] = push
            mujoco.mj_step(model, data, 10)
    assert np.abs(values[..., 0]).max() < 0.3, "it is held up"
    return Readings(actions, values), speeds


def unit_of(loop: OpenLoopReplay, mass: float, gain: float) -> np.ndarray:
    space = loop.physics.parameters
    return space.to_unit(space.from_dict({"mass": mass, "gain": gain}))


def right_unit(loop: OpenLoopReplay) -> np.ndarray:
    return unit_of(loop, TRUTH["mass"], TRUTH["gear"] / 0.35)


def test_a_base_begins_as_fast_as_its_wheels_roll(loop):
    state = np.zeros(10)
    wheels, pitch = np.array([3.0, 3.0]), 0.4  # rad/s; wheels turn on the trunk
    state[[5 + PITCH, 5 + LEFT, 5 + RIGHT]] = [pitch, *wheels]
    (rolled,) = loop.measured.bases.begun(state[None], right_unit(loop))
    assert rolled[5 + X] == pytest.approx(RADIUS * (wheels[0] + pitch), rel=1e-6)
    assert rolled[5 + Z] == pytest.approx(0, abs=1e-9)
    np.testing.assert_array_equal(rolled[[*range(5), 7, 8, 9]], state[[*range(5), 7, 8, 9]])


def test_a_base_in_the_air_begins_as_it_did(loop):
    state = np.zeros(10)
    state[[Z, 5 + X, 5 + LEFT, 5 + RIGHT]] = [0.1, 0.2, 3, 3]
    (rolled,) = loop.measured.bases.begun(state[None], right_unit(loop))
    np.testing.assert_array_equal(rolled, state)


@pytest.mark.parametrize(("mass", "gain", "share"), [(0.45, 1.143, 0.03), (0.6, 1.0, 0.1)])
def test_readings_take_the_base_along_whatever_the_parameters_are(loop, driven, mass, gain, share):
    readings, speeds = driven
    assert np.abs(speeds[:, 0]).min() > 0.05
    unit = unit_of(loop, mass, gain)
    read = loop.carried(loop.states_of(readings, unit, np.zeros(4)), unit, STEPS)
    away = read.states[..., 5 + X] - speeds
    assert np.sqrt(np.square(away).mean()) < share * np.sqrt(np.square(speeds).mean())


def test_a_robot_that_balances_is_found_from_afar(loop, driven):
    """Its mass and its motors' strength: pushes alone would tell only their ratio."""
    readings, finds = driven[0], finds_offset(loop.sensors)
    method = OutputErrorMethod(loop, finds, unit_of(loop, 0.6, 1.0))
    guess = Guess(unit_of(loop, 0.7, 0.8), np.zeros(4))
    stage = ReplayStage(8, Segments.evenly(readings, 12, 24))
    guess = method.descend(readings, guess, stage, Budget()).guess
    segments = method.follow(readings, guess)
    assert np.isin(np.arange(2), segments.episode).all()
    assert segments.steps.sum() > STEPS  # of both: more than half can be followed
    ended = method.descend(readings, guess, ReplayStage(4, segments, goes_on=True), Budget())
    np.testing.assert_allclose(ended.unit, right_unit(loop), atol=2e-3)  # .9 % of the mass
    left = ended.noise / [5e-4, 5e-3, 5e-4, 5e-4]
    assert left.max() < 1.1, "no more than the noise"


def test_no_robot_that_stands_is_said_to_lie_or_hang(tmp_path, driven, monkeypatch):
    """Upside down, one of twice the mass would fall less."""
    (tmp_path / "scene.xml").write_text(SCENE.format(mass=0.6, gear=0.35))
    (tmp_path / "tune.toml").write_text(TUNE)
    task, tried = load_task(str(tmp_path / "tune.toml")), []
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)

    def best(self, readings, changes):
        tried.extend(np.abs(change.shift).max() for change in changes)
        return 1e3, changes[0], []

    monkeypatch.setattr(ShortReplays, "best", best)
    monkeypatch.setattr(ShortReplays, "left", lambda *_: 1.0)
    monkeypatch.setattr(ShortReplays, "moves", lambda *_: False)
    assert misread(driven[0], simulator, seen) == []
    assert {round(shift / (np.pi / 4)) for shift in tried} == {0, 1}  # eighths of a turn


TOWER = """
<mujoco><worldbody>
  <body name="trunk"><joint name="x" type="slide"/><joint name="lean" axis="0 1 0"/>
    <geom size=".1"/>
    <body pos="0 0 .2"><joint name="wheel" axis="0 1 0"/><geom size=".05"/></body>
    <body pos="0 0 .3"><joint name="lid" axis="0 1 0"/><geom size=".05"/></body>
  </body>
  <body pos="2 0 0"><freejoint name="box"/><geom size=".1"/></body>
</worldbody></mujoco>
"""


def tower(folder: Path, *sensors: str) -> MeasuredStates:
    """What sensors of these joints read."""
    head = 'model = "scene.xml"\ncontrol_timestep_s = 0.02\n'
    for number, name in enumerate(sensors):
        joint, *speed = name.split(" ")
        head += f'[[sensors]]\nname = "{number}"\njoints = "{joint}"\n'
        head += 'quantity = "velocity"\n' * bool(speed)
    parameter = '[[parameters]]\nname = "mass"\nkind = "mass"\nobjects = "trunk"\n'
    start = '[initial_state]\nkind = "keyframe"\nkeyframe = "begin"\n'
    key = '<keyframe><key name="begin"/></keyframe></mujoco>'
    (folder / "scene.xml").write_text(TOWER.replace("</mujoco>", key))
    (folder / "tune.toml").write_text(head + start + parameter)
    return loop_in(folder).measured


@pytest.mark.parametrize(
    ("sensors", "parts", "unknown"),
    [
        (["wheel"], ["x", "lean"], 2 + 1),  # speeds, and the angle
        (["wheel", "lean"], ["x"], 1),
        (["wheel speed"], ["x", "lean"], 2 + 1),
        (["wheel", "lean speed"], ["x", "lean"], 1 + 1),
        (["lid", "wheel"], ["x", "lean"], 2 + 1),
        (["wheel", "lean", "x"], [], 0),
    ],
)
def test_bases_are_what_carries_measured_joints_and_is_not_measured(
    tmp_path, sensors, parts, unknown
):
    measured = tower(tmp_path, *sensors)
    model = measured.physics.simulator.model
    joints = {
        name: [*model.joint(name).qposadr, *(model.nq + model.joint(name).dofadr)]
        for name in ("x", "lean", "wheel", "lid")
    }
    assert [n for n, places in joints.items() if measured.bases.parts[places].any()] == parts
    assert bool(measured.bases) == bool(parts)
    assert len(measured.bases.tangents) == unknown
    assert not measured.pushed[measured.bases.parts].any()
    assert measured.pushed[model.joint("box").qposadr[0]]


def test_how_late_readings_are_does_not_move_a_base(loop, driven):
    """What was read moves with its speed; a base's speed at the first row is no change of it."""
    late, readings = loop.with_lateness(), driven[0]
    unit = np.append(right_unit(loop), late_unit(0.3))
    on_time = loop.states_of(readings, right_unit(loop), np.zeros(4)).states
    states, drift = (late.states_of(readings, unit, np.zeros(4))[i] for i in (1, 3))
    its = loop.measured.bases.parts
    np.testing.assert_array_equal(states[..., its], on_time[..., its])
    assert not drift[..., [X, Z, 5 + X, 5 + Z]].any()
    assert drift[..., LEFT].any()
