"""An arm pushes a block that no sensor measures: later segments begin where it was pushed."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from simtune.budget import Budget
from simtune.fit import Guess, OpenLoopReplay, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.readings.differences import DifferencePoint, _unless_exploded, differentiate
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments
from simtune.real.observed import observed
from simtune.tasks import load_task
from simtune.tuning.readings.warnings import _of_misfit, _of_offsets

STEPS, ARM, BLOCK = 60, 0, 1
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="arm"><joint name="arm" type="slide" axis="1 0 0" damping="1"/>
      <geom type="sphere" size=".02" mass=".3"/>
    </body>
    <body name="block" pos=".2 0 0"><joint name="block" type="slide" axis="1 0 0" damping="4"/>
      <geom type="box" size=".02 .05 .05" mass=".1"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="arm" kp="60" kv="6"/></actuator>
  <keyframe><key name="begin" qpos="0 0"/></keyframe>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.04
episode_steps = 60
initial_state = {kind = "keyframe", keyframe = "begin"}

[[sensors]]
name = "place"
joints = "arm"
noise = 0.001

[[parameters]]
name = "kp"
kind = "gain"
objects = "servo"
"""


def loop_of(folder: Path, scene: str, tune: str) -> OpenLoopReplay:
    (folder / "scene.xml").write_text(scene)
    (folder / "tune.toml").write_text(tune)
    task = load_task(str(folder / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    return set_up_loop(simulator, seen, task.parameters.nominal)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> tuple[OpenLoopReplay, Readings, np.ndarray]:
    """A replay, its readings of an arm that pushes twice, and (STEPS + 1,) places of the block."""
    loop = loop_of(tmp_path_factory.mktemp("pushed"), SCENE, TUNE)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data, places = mujoco.MjData(model), np.zeros((STEPS + 1, 2))
    actions = np.interp(np.arange(STEPS), [5, 25, 35, 50], [0, 0.4, 0.2, 0.5])[:, None]
    for t, data.ctrl[:] in enumerate(actions):
        mujoco.mj_step(model, data, 20)
        places[t + 1] = data.qpos
    return loop, Readings(actions[None], places[None, :, [ARM]]), places[:, BLOCK]


def unit_of(loop: OpenLoopReplay, kp: float = 60.0) -> np.ndarray:
    space = loop.physics.parameters
    return space.to_unit(space.from_dict({"kp": kp}))


@pytest.mark.parametrize("kp", [60.0, 40.0])
def test_what_is_pushed_goes_along_whatever_the_parameters_are(pushed, kp):
    loop, readings, block = pushed
    unit = unit_of(loop, kp)
    read = loop.carried(loop.states_of(readings, unit, np.zeros(1)), unit, STEPS)
    assert block[-1] > 0.2
    np.testing.assert_allclose(read.states[0, :, BLOCK], block, atol=0.02)


def test_no_farther_than_the_last_stretch_begins(pushed):
    loop, readings, block = pushed
    unit = unit_of(loop)
    read = loop.carried(loop.states_of(readings, unit, np.zeros(1)), unit, 40)
    np.testing.assert_allclose(read.states[0, 40, BLOCK], block[40], atol=0.02)
    assert (read.states[0, 41:, BLOCK] == 0).all()


def test_a_segment_goes_on_from_the_replay_of_the_one_before(pushed):
    loop, readings, block = pushed
    unit, segments = unit_of(loop), Segments.evenly(readings, 20)
    read = loop.states_of(readings, unit, np.zeros(1))
    elsewhere = read._replace(states=read.states + 0.3 * (np.arange(4) == BLOCK))
    parts = elsewhere.cut(segments, goes_on=True)
    states = parts.states.copy()
    states[0, BLOCK] -= 0.3
    predicted, begun = loop.play(parts, states[None], unit[None])
    assert segments.begin.tolist() == [0, 20, 40]
    np.testing.assert_allclose(
        loop.physics.states(begun)[0, :, BLOCK], block[segments.begin], atol=1e-3
    )
    np.testing.assert_allclose(predicted[0], parts.values, atol=2e-3)


def test_segments_of_no_steps_lead_on_without_being_compared(pushed):
    loop, readings, block = pushed
    unit = unit_of(loop)
    segments = Segments(np.zeros(2, int), np.array([0, 35]), np.array([0, 10]))
    parts = loop.states_of(readings, unit).cut(segments, goes_on=True)
    assert np.isfinite(parts.values).sum((1, 2)).tolist() == [0, 11]
    assert parts.actions.shape[1] == 35
    predicted, begun = loop.play(parts, parts.states[None], unit[None])
    np.testing.assert_allclose(loop.physics.states(begun)[0, 1, BLOCK], block[35], atol=1e-3)
    np.testing.assert_allclose(predicted[0, 1, :11], parts.values[1, :11], atol=2e-3)


def test_a_start_is_told_only_where_an_episode_begins(pushed):
    loop, readings, _ = pushed
    method = OutputErrorMethod(loop, np.zeros(1, bool), unit_of(loop))
    for begin in (0, 20):
        segments = Segments(np.zeros(1, int), np.array([begin]), np.array([20]))
        stage, guess = ReplayStage(1, segments, goes_on=True), Guess(unit_of(loop), np.zeros(1))
        ended = method.descend(readings, guess, stage, Budget())
        assert (method.judge(ended, Budget()).start is None) == (begin > 0)


def test_a_tie_and_a_sensor_tell_where_a_joint_is(tmp_path):
    tie = '<equality><joint joint1="block" joint2="arm"/></equality>'
    loop = loop_of(tmp_path, SCENE.replace("<actuator>", tie + "<actuator>"), TUNE)
    assert not loop.measured.goes_on.any()


def test_stretches_begin_with_the_velocity_that_is_read(pushed, tmp_path):
    """Where they begin follows from it, though not in this world from its servo."""
    readings, at = pushed[1], pushed[1].values[0, :, 0]
    speed = np.gradient(at, 0.04)
    sensor = 'quantity = "velocity"\nnoise = 0.01'
    loop = loop_of(tmp_path, SCENE, TUNE.replace("noise = 0.001", sensor))
    assert loop.measured.goes_on.tolist() == [True, True, False, True]
    unit, read = unit_of(loop, 40.0), replace(readings, values=speed[None, :, None])
    parts = loop.cut(read, unit, segments=Segments.evenly(read, 10))
    np.testing.assert_array_equal(parts.states[:, 2], speed[::10][:-1])
    np.testing.assert_allclose(parts.states[:, 0], at[::10][:-1], atol=0.04)
    followed = loop.cut(read, unit, 0.0, Segments.evenly(read, 10), goes_on=True)
    predicted, _ = loop.play(followed, followed.states[None], unit[None])
    np.testing.assert_allclose(predicted[0, :, 0, 0], speed[::10][:-1])


def test_only_what_touches_is_derived_from_both_sides(pushed, monkeypatch):
    loop, readings, _ = pushed
    unit, zero, played = unit_of(loop), np.zeros(1), list[int]()
    play = OpenLoopReplay.play

    def counted(self, stretches, states, units):
        played.append(len(units))
        return play(self, stretches, states, units)

    monkeypatch.setattr(OpenLoopReplay, "play", counted)
    for begin, touches in ((0, False), (10, True)):
        segments = Segments(np.zeros(1, int), np.array([begin]), np.array([8]))
        parts = loop.cut(readings, unit, zero, segments)
        assert loop.touches(parts, unit) == touches
        at = DifferencePoint(parts, parts.states, unit, np.full(2, 0.001), touches)
        differentiate(loop, at, one_sided=True)
        assert played[-1] == 1 + 1 + touches + 2  # here; one parameter; a position and a speed


FREE = '<freejoint name="block"/>'
GLIDES = '<joint name="block" type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'


@pytest.mark.parametrize("joint", [FREE, GLIDES])
def test_what_is_out_of_reach_does_not_go_on(tmp_path, joint):
    """An object that begins anywhere: it touches nothing in replays."""
    slides = '<joint name="block" type="slide" axis="1 0 0" damping="4"/>'
    scene = SCENE.replace(slides, joint)
    scene, same = scene[: scene.index("<keyframe>")] + "</mujoco>", "[[0.2, 0.2], [0, 0], [0, 0]]"
    anywhere = same.replace("0.2]", "0.3]") if joint == FREE else "[-0.1, 0.1]"
    for place, goes_on in ((anywhere, False), (same if joint == FREE else "[0, 0]", True)):
        start = f'{{kind = "distribution", joints = {{block = {{position = {place}}}}}}}'
        tune = TUNE.replace('{kind = "keyframe", keyframe = "begin"}', start)
        loop = loop_of(tmp_path, scene, tune)
        assert loop.measured.goes_on.any() == goes_on
        assert loop.left_out == (() if goes_on else ("block",))


@pytest.mark.parametrize("quantity", ["position", "velocity"])
def test_stretches_begin_with_what_is_read_behind_a_backlash(pushed, tmp_path, quantity):
    """No play is added to it that went on from the stretch before."""
    readings = pushed[1]
    play = '[[backlash]]\njoint = "arm"\nplay = 0.03\narmature = 0.1\n'
    tune = TUNE.replace("[[sensors]]", play + "\n[[sensors]]")
    behind = f'noise = 0.001\nbehind_backlash = true\nquantity = "{quantity}"'
    tune = tune.replace('initial_state = {kind = "keyframe", keyframe = "begin"}', "")
    loop = loop_of(tmp_path, SCENE, tune.replace("noise = 0.001", behind))
    unit = unit_of(loop)
    if quantity == "velocity":
        readings = replace(readings, values=np.gradient(readings.values, 0.04, axis=1))
    for goes_on in (False, True):
        segments = Segments.evenly(readings, 15)
        parts = loop.cut(readings, unit, 0.0, segments, goes_on)
        predicted, _ = loop.play(parts, parts.states[None], unit[None])
        np.testing.assert_allclose(predicted[0, :, 0], parts.values[:, 0], atol=1e-9)


def test_a_stretch_that_explodes_has_no_derivative():
    changes = np.zeros((2, 3, 4, 1))
    changes[0, 1, 2], changes[1, 2, 3], changes[1, 0, 0] = 1e9, np.nan, 3.0
    kept = _unless_exploded(changes, np.full((3, 1, 1), 100.0))
    assert not kept[0].any()
    assert not kept[1, 2].any()
    assert kept[1, 0, 0] == 3.0


def test_a_flywheel_that_turns_far_has_derivatives(tmp_path):
    """A step of its damping moves it by 600 rad, of 48,000 in all."""
    scene = """<mujoco><option timestep="0.01" integrator="implicitfast"/><worldbody>
      <body><joint name="wheel" axis="0 1 0" damping="1e-4" armature="1e-3"/>
        <geom type="sphere" size=".05" mass=".01"/></body></worldbody>
      <actuator><motor name="motor" joint="wheel"/></actuator></mujoco>"""
    tune = TUNE[: TUNE.index("initial_state")] + TUNE[TUNE.index("[[sensors]]") :]
    tune = tune.replace('"arm"', '"wheel"').replace('"kp"', '"damping"').replace("servo", "wheel")
    loop = loop_of(tmp_path, scene, tune.replace('"gain"', '"damping"'))
    actions = np.full((1, 1500, 1), 0.1)
    rest = Readings(actions, np.zeros((1, 1501, 1)))
    unit = loop.physics.parameters.to_unit(np.array([1e-4]))
    whole = loop.cut(rest, unit)
    std = np.ones(len(loop.measured.start_tangents))
    slopes = differentiate(loop, DifferencePoint(whole, whole.states, unit, std))
    assert not slopes.by_parameter.any(), "what was read hardly moved"
    assert np.ptp(slopes.predicted) > 1e4
    turned = whole._replace(values=slopes.predicted)
    slopes = differentiate(loop, DifferencePoint(turned, whole.states, unit, std))
    assert np.abs(slopes.by_parameter).max() * 5e-3 > 100


def test_offsets_that_hardly_count_beside_what_is_left_are_told():
    """A gripper that holds a cube stays away from where it is sent, in most of the readings."""
    seen = SimpleNamespace(reading_labels=("arm", "elbow", "gripper", "wrist"))
    offsets, left = np.array([0.02, 0.0, 0.09, 0.004]), np.array([0.005, 0.01, 0.15, 0.0])
    (said,) = _of_offsets(offsets, left, seen)  # pyright: ignore[reportArgumentType]
    assert said.startswith("The offsets of gripper are smaller than what else is left")
    assert _of_offsets(2 * offsets, left, seen) == []  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("left_out", [(), ("cube",)])
def test_what_is_left_out_is_named_where_readings_are_not_explained(pushed, left_out):
    seen = SimpleNamespace(sensors=pushed[0].sensors, reading_labels=("place",))
    (said,) = _of_misfit(np.array([0.1]), seen, left_out)  # pyright: ignore[reportArgumentType]
    assert ("Nothing touches cube in these replays" in said) == bool(left_out)
    assert _of_misfit(np.array([0.001]), seen, left_out) == []  # pyright: ignore[reportArgumentType]
