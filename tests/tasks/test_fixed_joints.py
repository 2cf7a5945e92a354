"""`fixed_joints` and [[actuators]]: a humanoid whose legs do not matter becomes an arm."""

import mujoco
import numpy as np
import pytest

SCENE = """
<mujoco>
  <compiler angle="degree" eulerseq="XYZ"/>
  <worldbody>
    <camera name="front" pos="0 -3 1" xyaxes="1 0 0 0 0 1"/>
    <frame pos="0 0 1" euler="0 20 0">
      <body name="pelvis" pos="1 2 3" euler="10 20 30">
        <freejoint/>
        <geom size=".1"/>
        <frame pos=".1 0 0" euler="0 0 30">
          <body name="thigh" pos=".3 0 0" axisangle="0 0 1 40">
            <joint name="left_hip_x" axis="0 1 0" pos=".05 0 .1" ref="10" range="-90 90"/>
            <joint name="left_hip_y" axis="1 0 0" pos="0 .2 0" range="-90 90"/>
            <joint name="left_slide" type="slide" axis="0 1 1"/>
            <geom size=".1" pos=".1 0 0"/>
            <body name="foot" pos="0 0 .3">
              <joint name="toe" type="ball"/>
              <geom size=".1" pos="0 .1 .1"/>
            </body>
          </body>
          <body name="arm" pos="0 0 .4">
            <joint name="elbow" axis="0 1 0" range="-30 60" damping="1"/>
            <geom name="arm" size=".1" pos=".3 0 0"/>
          </body>
        </frame>
      </body>
    </frame>
  </worldbody>
  <tendon>
    <fixed name="both"><joint joint="left_hip_x" coef="1"/><joint joint="elbow" coef="2"/></fixed>
  </tendon>
  <equality>
    <joint joint1="left_hip_x" joint2="elbow" active="false"/>
    <tendon tendon1="both" active="false"/>
    <joint name="stays" joint1="elbow" active="false"/>
  </equality>
  <actuator>
    <motor name="hip" joint="left_hip_x"/>
    <position name="bend" joint="elbow" kp="20" timeconst=".1"/>
    <motor name="pull" tendon="both"/>
  </actuator>
  <sensor>
    <jointpos joint="left_hip_x"/> <actuatorpos actuator="hip"/> <tendonpos tendon="both"/>
    <jointpos name="angle" joint="elbow"/> <framepos objtype="body" objname="foot"/>
  </sensor>
  <keyframe>
    <key name="sit" qpos="1 1 1 .6 .8 0 0  .5 -.3 .1  .6 0 .8 0  .4" act=".3" ctrl="1 2 3"/>
  </keyframe>
</mujoco>
"""
HEAD = 'model = "scene.xml"\ncontrol_timestep_s = 0.05\n'
MASS = '[[parameters]]\nname = "m"\nkind = "mass"\nobjects = "arm"\n'


def poses(model: mujoco.MjModel, positions: dict[str, float], qpos: np.ndarray) -> dict:
    """{body: (7,) place and orientation}; joints as in `qpos` but for the named ones."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    for joint, value in positions.items():
        data.joint(joint).qpos[:] = value
    mujoco.mj_kinematics(model, data)
    quats = data.xquat * np.where(data.xquat[:, :1] < 0, -1, 1)
    every = np.hstack([data.xpos, quats])
    return {model.body(i).name: every[i] for i in range(model.nbody)}


@pytest.mark.parametrize(
    ("fixed", "kept"),
    [
        ('["left_*", "joint 0", "toe"]', {"elbow": 0.7}),
        ('["left_hip_y", "left_slide", "joint 0"]', {"left_hip_x": 0.9, "elbow": -0.2}),
        ('"left_hip_x"', {"left_hip_y": 0.9, "left_slide": 0.3}),
    ],
)
def test_bodies_stay_where_the_pose_has_them_and_other_joints_move_as_before(load, fixed, kept):
    whole = mujoco.MjModel.from_xml_string(SCENE)
    key = whole.key("sit").qpos
    model = load(f'{HEAD}fixed_joints = {fixed}\nfixed_pose = "sit"\n{MASS}').load_model()
    expected, found = poses(whole, kept, key), poses(model, kept, model.key("sit").qpos)
    for body, pose in expected.items():
        np.testing.assert_allclose(found[body], pose, atol=1e-6, err_msg=body)
    plain = load(f"{HEAD}fixed_joints = {fixed}\n{MASS}").load_model()
    expected, found = poses(whole, kept, whole.qpos0), poses(plain, kept, plain.qpos0)
    for body, pose in expected.items():
        np.testing.assert_allclose(found[body], pose, atol=1e-6, err_msg=body)


LOOPS = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -3 1" xyaxes="1 0 0 0 0 1"/>
    <body name="base">
      <joint name="lift" axis="0 1 0"/>
      <geom size=".1"/>
      <body name="arm" pos="1 0 0">
        <joint name="elbow" axis="0 1 0" springdamper=".1 1"/>
        <geom size=".1" pos=".5 0 0"/>
        <site name="near" pos=".5 0 0"/>
      </body>
    </body>
    <body name="rod" pos="2 0 0">
      <joint name="pivot" axis="0 1 0"/>
      <geom size=".1" pos="0 0 .5"/>
      <site name="far" pos="0 0 .5"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cord" stiffness="3"><site site="near"/><site site="far"/></spatial>
  </tendon>
  <equality>
    <connect body1="arm" body2="rod" anchor=".5 0 0"/>
    <connect body1="arm" anchor=".3 0 0"/>
    <weld body1="arm" body2="rod"/>
    <tendon tendon1="cord"/>
  </equality>
  <actuator><position joint="elbow" kp="10" dampratio="1"/></actuator>
  <keyframe><key name="up" qpos=".5 .1 .2"/></keyframe>
</mujoco>
"""


def forces(model: mujoco.MjModel) -> list[np.ndarray]:
    """Of ties (how far they are off), springs and dampers, in the last two joints."""
    data = mujoco.MjData(model)
    data.qpos[-2:], data.qvel[-2:] = (0.1, 0.2), (1, 2)
    if model.nq == 3:
        data.qpos[0] = 0.5
    mujoco.mj_forward(model, data)
    return [data.efc_pos[:12], data.qfrc_passive[-2:], data.qfrc_actuator[-2:]]


def test_springs_dampers_and_loops_of_a_moved_model_stay_the_models(load, refuses, folder):
    text = HEAD + 'fixed_joints = "lift"\nfixed_pose = "up"\n' + MASS
    (folder / "scene.xml").write_text(LOOPS)
    refuses(text, 3, "ties tendons by their lengths in the default state")
    (folder / "scene.xml").write_text(LOOPS.replace('<tendon tendon1="cord"/>', ""))
    whole = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    for found, expected in zip(forces(load(text).load_model()), forces(whole), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)
        assert np.abs(expected).max() > 0.1


def test_all_that_refers_to_a_fixed_joint_goes_along(load):
    task = load(HEAD + 'fixed_joints = ["left_*", "joint 0", "toe"]\n' + MASS)
    model = task.load_model()
    assert (model.nq, model.nv, model.nu, model.na) == (1, 1, 1, 1)
    assert (model.ntendon, model.neq, model.nsensor) == (0, 1, 2)
    assert (model.equality(0).name, model.sensor(0).name) == ("stays", "angle")
    assert task.load_actions().names == ("bend",)
    key = model.key("sit")
    assert (*key.qpos, *key.act, *key.ctrl) == (0.4, 0.3, 2)


def test_a_joint_alone_leaves_what_others_need(load):
    model = load(HEAD + 'fixed_joints = ["left_slide"]\n' + MASS).load_model()
    assert (model.nq, model.nu, model.ntendon, model.neq, model.nsensor) == (14, 3, 1, 3, 5)
    np.testing.assert_allclose(model.key("sit").qpos[7:10], [0.5, -0.3, 0.6])


def test_servos_are_added_and_hold_the_keyframe(load):
    servos = """
[[actuators]]
joint = ["elbow", "left_hip_*"]
kp = 30
kv = 2
torque_limit = 5
[[actuators]]
name = "slow"
joint = "elbow"
kp = 3
limited = false
"""
    model = load(HEAD + 'fixed_joints = ["joint 0"]\n' + servos + MASS).load_model()
    names = [model.actuator(i).name for i in range(model.nu)]
    assert names == ["hip", "bend", "pull", "elbow", "left_hip_x", "left_hip_y", "slow"]
    elbow, slow = model.actuator("elbow"), model.actuator("slow")
    np.testing.assert_allclose(elbow.biasprm[:3], [0, -30, -2])
    np.testing.assert_allclose(elbow.ctrlrange, np.deg2rad([-30, 60]))
    assert (*elbow.forcerange, elbow.forcelimited, elbow.ctrllimited) == (-5, 5, 1, 1)
    assert (slow.gainprm[0], *slow.forcelimited, *slow.ctrllimited) == (3, 0, 0)
    np.testing.assert_allclose(model.key("sit").ctrl, [1, 2, 3, 0.4, 0.5, -0.3, 0.4])


def test_an_added_servo_is_as_its_table_says_whatever_the_models_are_by_default(load, folder):
    geared = """<default><general gear="50" damping="3" armature="2" delay=".1" nsample="60"
      interp="linear"/><position inheritrange="1"/></default><worldbody>"""
    (folder / "scene.xml").write_text(SCENE.replace("<worldbody>", geared))
    servo = "[[actuators]]\nname = 'servo'\njoint = 'elbow'\nkp = 30\n"
    model = load(f"{HEAD}{servo}{MASS}").load_model()
    added = model.actuator("servo")
    assert added.gear.tolist() == [1, 0, 0, 0, 0, 0]
    for field in ("damping", "armature", "delay", "history"):
        assert not getattr(model, f"actuator_{field}")[added.id].any(), field
    np.testing.assert_allclose(added.ctrlrange, np.deg2rad([-30, 60]))


def test_an_added_servo_has_no_activation_whatever_the_models_have_by_default(load, folder):
    filtered = """<default><general dyntype="filter" actlimited="true" actrange="-1 1"
      actearly="true"/></default><worldbody>"""
    undriven = SCENE[: SCENE.index("  <actuator>")] + "</mujoco>"
    (folder / "scene.xml").write_text(undriven.replace("<worldbody>", filtered))
    model = load(f"{HEAD}[[actuators]]\njoint = 'elbow'\nkp = 30\n{MASS}").load_model()
    assert (model.nu, model.na, *model.actuator_actlimited) == (1, 0, 0)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("fixed_joints = ['elbw']\n", 3, "no joint 'elbw' in the model; did you mean 'elbow'?"),
        ("fixed_joints = ['right_*']\n", 3, r"no joint 'right_\*' in the model; (did|there are)"),
        ("fixed_joints = 3\n", 3, "fixed_joints must be a name or a list of names, got 3"),
        ("fixed_joints = 'toe'\nfixed_pose = 'sat'\n", 4, "no keyframe 'sat' .* mean 'sit'"),
        ("fixed_pose = 'sit'\n", 3, "fixed_pose is of fixed_joints, and there are none"),
        ("[[actuators]]\njoint = 'elbow'\n", 3, r"\[\[actuators\]\] has no kp"),
        ("[[actuators]]\nkp = 3\njoint = 'toe'\n", 5, "a hinge or a slide, and 'toe' is neither"),
        (
            "[[actuators]]\nkp = 3\nkv = -1\njoint = 'elbow'\n",
            5,
            "of at least 0, got -1",
        ),
        (
            "[[actuators]]\nkp = 3\njoint = 'elbow'\nname = 'bend'\n",
            3,
            "there is an actuator 'bend' already",
        ),
        (
            "[[actuators]]\nkp = 3\njoint = 'left_hip_*'\nname = 'x'\n",
            6,
            "name is of one servo, and joint names 2",
        ),
        (
            "fixed_joints = 'elbow'\n[[actuators]]\nkp = 3\njoint = 'elbow'\n",
            6,
            "no joint 'elbow' in the model",
        ),
    ],
)
def test_what_cannot_be_fixed_or_driven_is_told_with_its_line(refuses, text, line, message):
    refuses(HEAD + text + MASS, line, message)


def test_a_model_without_what_is_asked_for_says_so(load, refuses, tmp_path):
    bare = "<mujoco><worldbody><camera name='c'/></worldbody></mujoco>"
    (tmp_path / "scene.xml").write_text(bare)
    refuses(HEAD + "fixed_joints = 'a'\n" + MASS, 3, "no joint 'a' in the model, which has none")
