"""Play between a motor and what it moves, by hand on one joint, and found from readings."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import servo_arm
from test_servos import a_run

from simtune.budget import Budget
from simtune.config import ExportConfig, TuneConfig
from simtune.experiment.experiment import build_experiment
from simtune.export import export
from simtune.parameters import ModelWriter
from simtune.parameters.backlash_joints import driven_through, play_of

# A bob of 1 kg at 0.5 m, whose weight pulls the arm down at angle 0: 4.905 N·m.
SCENE = """
<mujoco>
  <compiler angle="{angle}"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="elbow" axis="0 -1 0" armature="{armature}"/>
      <geom name="bob" size=".01" pos=".5 0 0" mass="1"/>
      <body name="hand" pos=".5 0 0">
        <joint name="wrist" type="slide"/>
        <geom size=".01" mass=".001"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="elbow" joint="elbow" kp="400" kv="20"/></actuator>
  <keyframe><key name="up" qpos="1 .02" qvel="3 4" ctrl=".7"/></keyframe>
</mujoco>
"""
HEAD = 'model = "scene.xml"\ncontrol_timestep_s = 0.02\n'
SENSOR = '[[sensors]]\nname = "s"\njoints = "elbow"\n'
TABLE = '[[backlash]]\njoint = "elbow"\nplay = 0.04\n'
SLIDE = '[[backlash]]\njoint = "wrist"\narmature = 1\n' + SENSOR
PLAY = """
[[parameters]]
name = "play"
kind = "backlash"
objects = "elbow_backlash"
"""
MASS = '[[parameters]]\nname = "m"\nkind = "mass"\nobjects = "arm"\n'


@pytest.fixture
def scene(folder: Path):
    def write(angle: str = "radian", armature: float = 0.1) -> None:
        (folder / "scene.xml").write_text(SCENE.format(angle=angle, armature=armature))

    write()
    return write


@pytest.mark.parametrize("angle", ["radian", "degree"])
def test_an_arm_hangs_at_one_end_of_its_play(load, scene, angle):
    scene(angle)
    task = load(HEAD + SENSOR + TABLE + PLAY)
    assert task.parameters["play"].nominal == pytest.approx(0.04)
    assert (task.parameters["play"].low, task.parameters["play"].scale) == (0.004, "log")
    simulator, still = task.simulator(image_size=16), np.zeros((2, 50, 1))
    worlds, rng = np.array([[0.04], [0.1]]), np.random.default_rng(0)
    start = simulator.state_space.with_positions_and_velocities(
        simulator.roll_out(worlds, still, rng).states[:, 0], np.zeros(6)
    )
    states = simulator.roll_out(worlds, still, rng, starts=start).states[:, -1]
    positions = simulator.state_space.positions_and_velocities(states)
    # The motor sags by weight / kp; the arm hangs lower by half of the play
    sag = -4.91 / 400 * np.cos([0.032, 0.062])
    np.testing.assert_allclose(positions[:, 0], sag, rtol=0.01)
    np.testing.assert_allclose(positions[:, 1], [-0.02, -0.05], atol=3e-4)


def test_what_is_measured_is_before_or_behind_the_play(load, scene):
    class Batch:
        qpos, qvel = np.array([[1.0, 0.1, 7.0]]), np.array([[2.0, 0.2, 8.0]])

    behind = "behind_backlash = true\n"
    for text, expected in ((SENSOR, 1.0), (SENSOR + behind, 1.1)):
        (sensor,) = load(HEAD + TABLE + text + PLAY).sensors
        assert sensor.observe(Batch) == pytest.approx(expected)
    velocity = SENSOR + 'quantity = "velocity"\n' + behind
    assert load(HEAD + TABLE + velocity + PLAY).sensors[0].observe(Batch) == pytest.approx(2.2)


STICKY = """<default><joint damping="2" frictionloss="1" stiffness="3" armature=".5" ref="1"
  springref="2" margin=".1" actuatorfrcrange="-1 1" actuatorgravcomp="true"/>
  <default class="sprung"><joint springdamper=".1 1"/></default></default><worldbody>"""


@pytest.mark.parametrize("body_class", ["", 'childclass="sprung"'])
def test_nothing_holds_a_play_whatever_joints_of_the_model_are_by_default(load, folder, body_class):
    scene = SCENE.format(angle="radian", armature=0.1).replace("<worldbody>", STICKY)
    (folder / "scene.xml").write_text(scene.replace('name="arm"', f'name="arm" {body_class}'))
    model = load(HEAD + SENSOR + TABLE + MASS).load_model()
    play = model.joint("elbow_backlash")
    for field in ("dof_damping", "dof_frictionloss", "dof_armature"):
        assert getattr(model, field)[play.dofadr[0]] == 0, field
    for field in ("stiffness", "margin", "actfrclimited", "actgravcomp"):
        assert getattr(model, f"jnt_{field}")[play.id] == 0, field
    assert model.qpos0[play.qposadr[0]] == model.qpos_spring[play.qposadr[0]] == 0
    assert model.joint("elbow").armature == pytest.approx(0.1)


def test_a_play_turns_about_its_joint_within_a_frame(load, folder):
    scene = SCENE.format(angle="degree", armature=0.1)
    joint = '<joint name="elbow" axis="0 -1 0" armature="0.1"/>'
    assert joint in scene
    turned = f'<frame pos=".1 0 .2" euler="30 40 0">{joint}</frame>'
    (folder / "scene.xml").write_text(scene.replace(joint, turned))
    model = load(HEAD + SENSOR + TABLE + PLAY).load_model()
    assert driven_through(model, model.joint("elbow_backlash").id) == model.joint("elbow").id


def test_keyframes_have_a_play_in_its_middle(load, scene):
    model = load(HEAD + SENSOR + TABLE + PLAY).load_model()
    assert [model.joint(i).name for i in range(3)] == ["elbow", "elbow_backlash", "wrist"]
    assert model.key_qpos[0].tolist() == [1, 0, 0.02]
    assert model.key_qvel[0].tolist() == [3, 0, 4]
    assert model.key_ctrl[0].tolist() == [0.7]


def test_a_play_that_the_model_has_is_found_by_its_shape(load, scene, folder):
    text = (folder / "scene.xml").read_text()
    play = '<joint name="gears" axis="0 -1 0" range="-.03 .03" limited="true"/><geom name="bob"'
    (folder / "scene.xml").write_text(
        text.replace('<geom name="bob"', play).replace('qpos="1 .02" qvel="3 4"', "")
    )
    sensor = SENSOR + "behind_backlash = true\n"
    task = load(HEAD + sensor + PLAY.replace("elbow_backlash", "gears"))
    assert task.parameters.nominal == pytest.approx(0.06)
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([0.01]))
    assert model.joint("gears").range.tolist() == pytest.approx([-0.005, 0.005])


HAND = MASS.replace("arm", "hand")
PAIR = """<mujoco><worldbody><body name="arm"><joint name="left_1" axis="0 1 0" armature="1"/>
  <geom size=".1"/><body name="hand"><joint name="left_2" armature="1"/><geom size=".1"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("joints", ["'left_*'", "['joints of arm', 'joints of hand']"])
def test_a_play_is_not_among_joints_meant_by_a_pattern(load, folder, joints):
    (folder / "scene.xml").write_text(PAIR)
    tables = f"""
[[backlash]]
joint = {joints}
[[actuators]]
joint = {joints}
kp = 1
[[sensors]]
name = "s"
joints = {joints}
[[parameters]]
name = "zero"
kind = "joint_offset"
objects = {joints}
[[parameters]]
name = "plays"
kind = "backlash"
objects = "*_backlash"
"""
    task = load(HEAD + tables)
    assert task.load_actions().names == task.sensors[0].columns == ("left_1", "left_2")
    zero, plays = (parameter.objects for parameter in task.parameters)
    assert (zero, plays) == (("left_1", "left_2"), ("left_1_backlash", "left_2_backlash"))
    (folder / "scene.xml").write_text(task.spec_for().to_xml())  # the plays are the model's own
    fixed = load(HEAD + 'fixed_joints = "*_1*"\n' + SENSOR.replace("elbow", "left_2") + HAND)
    assert [fixed.load_model().joint(i).name for i in range(2)] == ["left_2", "left_2_backlash"]


@pytest.mark.parametrize(("place", "expected"), [("0 0 0", (1, 0)), (".1 0 0", (-1, -1))])
def test_a_hinge_at_another_place_of_the_body_is_no_play(place: str, expected: tuple[int, int]):
    play = f'<joint axis="0 -1 0" pos="{place}" range="-2 2" limited="true"/><geom name="bob"'
    scene = SCENE.format(angle="degree", armature=1).replace('<geom name="bob"', play)
    model = mujoco.MjModel.from_xml_string(scene.replace('qpos="1 .02" qvel="3 4"', ""))
    assert (play_of(model, 0), driven_through(model, 1)) == expected


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (TABLE + SENSOR + PLAY.replace("_backlash", ""), 13, "elbow is no play between a motor"),
        (SENSOR + "behind_backlash = true\n" + MASS, 6, "none of the joints has one: declare"),
        (TABLE.replace("elbow", "wrst") + PLAY, 4, "no joint 'wrst' in the model; did you mean"),
        (TABLE + "armature = 0\n" + PLAY, 6, "its rotor, which has no inertia: give it an arma"),
        (SLIDE, 4, "'wrist' is a slide, which has no usual play: give play, in m"),
        (TABLE.replace("0.04", "0") + PLAY, 5, "play must be a finite number above 0, got 0"),
        (TABLE + TABLE + PLAY, 7, "there is a joint 'elbow_backlash' already"),
    ],
)
def test_what_cannot_have_a_play_is_refused_with_its_line(refuses, scene, text, line, message):
    refuses(HEAD + text, line, message)


def test_what_is_exported_has_the_play(load, scene, tmp_path, folder):
    task = load(HEAD + SENSOR + TABLE + PLAY)
    run = a_run(folder, task, np.array([0.07]))
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    tuned = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert tuned.joint("elbow_backlash").range.tolist() == pytest.approx([-0.035, 0.035])


TRUTH = {"elbow_kp": 15, "elbow_friction": 0.15, "play": 0.03}


@pytest.mark.thorough
@pytest.mark.parametrize("is_behind", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_play_is_found_again(tmp_path: Path, is_behind: bool):
    """Behind it a reading shows it; before it only the motion does, and the interval says so."""
    head = servo_arm.HEAD.replace("0.002\n", "0.001\noffset = 0\n")
    head = head.replace("[[sensors]]", '[[backlash]]\njoint = "elbow"\n\n[[sensors]]')
    behind = "behind_backlash = true\n" * is_behind
    arm = servo_arm.write_arm(tmp_path, head + behind + servo_arm.ELBOW + PLAY, 0.005)
    (tmp_path / "truth.json").write_text(json.dumps(TRUTH))
    config = TuneConfig(
        task=str(arm), out=tmp_path / "run", real_parameters=tmp_path / "truth.json",
        real_episodes=3, observe="joints", seed=1,
    )  # fmt: skip
    experiment = build_experiment(config)
    found = experiment.search.run_round(experiment.recordings, Budget()).estimate
    real = experiment.space.from_dict(TRUTH)
    assert ((found.low <= real) & (real <= found.high)).all()
    assert found.mean[2] == pytest.approx(0.03, rel=0.1)
    half_width = np.log(found.high[2] / found.low[2]) / 2
    assert (half_width < 0.07) == is_behind
    assert is_behind or found.verdict[2] == "weak"
