"""Models as they are: without names, in several files, as URDF; how a file names their parts."""

import re
import subprocess
import sys
import tomllib

import mujoco
import numpy as np
import pytest
from test_servos import a_run

import simtune
from simtune.config import ExportConfig
from simtune.errors import InputError, UnknownName
from simtune.export import export
from simtune.run.sources import keep_sources
from simtune.tasks import load_task

SCENE = """
<mujoco>
  <worldbody>
    <camera pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <geom size=".1"/>
    <body name="forearm">
      <joint name="left_elbow" axis="0 1 0"/>
      <joint axis="1 0 0"/>
      <geom size=".1" pos=".3 0 0"/>
      <geom size=".05" pos=".5 0 0"/>
      <body>
        <joint name="left_wrist"/>
        <geom name="hand" size=".1" pos=".7 0 0"/>
      </body>
    </body>
    <body name="rock"/>
  </worldbody>
  <actuator>
    <position joint="left_elbow" kp="3"/>
    <position joint="joint_by_name" kp="4"/>
    <motor name="left_wrist" joint="left_wrist"/>
    <damper joint="left_elbow" kv="1" ctrlrange="0 1"/>
  </actuator>
  <keyframe><key qpos=".1 .2 .3"/></keyframe>
</mujoco>
""".replace('joint="joint_by_name"', 'joint="left_wrist"')
CUBE = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
HEAD = 'model = "scene.xml"\ncontrol_timestep_s = 0.05\n'
MASS = '[[parameters]]\nname = "m"\nkind = "mass"\nobjects = "forearm"\n'


@pytest.fixture
def objects(load):
    """The objects of a parameter of a kind."""

    def objects(kind: str, named: str, more: str = "") -> tuple[str, ...]:
        text = f"[[parameters]]\nname = 'p'\nkind = '{kind}'\nobjects = {named}\n{more}"
        return load(HEAD + text).parameters.parameters[0].objects

    return objects


def test_what_has_no_name_is_called_by_its_kind_and_index(load):
    task = load(
        HEAD
        + '[initial_state]\nkind = "keyframe"\nkeyframe = "keyframe 0"\n'
        + '[actions]\nactuators = ["actuator 1", "actuator 0"]\n'
        + '[[parameters]]\nname = "p"\nkind = "friction"\nobjects = "geom 2"\n'
    )
    model = task.load_model()
    assert [model.geom(i).name for i in range(model.ngeom)] == [f"geom {i}" for i in range(3)] + [
        "hand"
    ]
    assert [model.body(i).name for i in range(4)] == ["world", "forearm", "body 2", "rock"]
    assert [model.joint(i).name for i in range(3)] == ["left_elbow", "joint 1", "left_wrist"]
    assert task.load_actions().names == ("actuator 1", "actuator 0")
    assert task.cameras[0].camera == "camera 0"


def test_names_do_not_change_what_is_simulated(load):
    model, plain = load(HEAD + MASS).load_model(), mujoco.MjModel.from_xml_string(SCENE)
    worlds = [(m, mujoco.MjData(m)) for m in (model, plain)]
    for m, data in worlds:
        data.ctrl[:] = 0.3
        mujoco.mj_step(m, data, nstep=50)
    np.testing.assert_array_equal(worlds[0][1].qpos, worlds[1][1].qpos)


def test_objects_are_named_by_patterns_and_by_what_they_belong_to(objects):
    some = "nominal = 1"
    assert objects("armature", "'joint 1'", some) == ("joint 1",)
    assert objects("friction", "'geoms of forearm'") == ("geom 1", "geom 2")
    assert objects("friction", "['hand', 'geom*']") == ("hand", "geom 0", "geom 1", "geom 2")
    assert objects("gain", "'actuator of left_wrist'") == ("actuator 1", "left_wrist")
    assert objects("joint_offset", "'joints of forearm'") == ("left_elbow", "joint 1")
    assert objects("joint_offset", "'joints of *'") == ("left_elbow", "joint 1", "left_wrist")
    assert objects("friction", "'geoms of [!f]*'") == ("hand",), "not the world's"
    assert objects("gain", "'actuators of left_w*'") == ("actuator 1", "left_wrist")
    assert objects("joint_offset", "['left_*', 'joint ?']") == (
        "left_elbow",
        "left_wrist",
        "joint 1",
    )
    assert objects("mass", "['forearm', 'for*']") == ("forearm",)
    assert objects("gravity_compensation", "'[!r]*'") == ("forearm", "body 2")  # not the world


@pytest.mark.parametrize(
    ("kind", "named", "message"),
    [
        ("friction", "'geoms of rock'", "body 'rock' has no geom"),
        ("friction", "'geoms of forarm'", "no body 'forarm' in the model; did you mean 'forearm'?"),
        ("friction", "'geoms of hose*'", r"no body 'hose\*' in the model; (did you|there are)"),
        ("gain", "'actuator of joint 1'", "joint 'joint 1' has no actuator"),
        ("gain", "'right_*'", r"no actuator 'right_\*' in the model; (did you|there are)"),
        ("mass", "'geoms of forearm'", "no body 'geoms of forearm' in the model"),
        ("gravity_compensation", "'*'", "rock cannot move, so its gravcomp changes nothing"),
        ("gain", "['left_wrist', 'left_wrist']", "'left_wrist' is named twice"),
        ("tendon_damping", "'rope'", "no tendon 'rope' in the model, which has none"),
    ],
)
def test_names_of_nothing_are_told_with_what_there_is(objects, kind, named, message):
    with pytest.raises(InputError, match=message) as caught:
        objects(kind, named)
    assert "tune.toml:6: " in str(caught.value)


def test_no_list_of_names_ends_empty():
    assert str(UnknownName("site", "tip", "the model", [])) == (
        "no site 'tip' in the model, which has none"
    )
    assert str(UnknownName("site", "q", "the model", ["tip"])).endswith("; there are: tip")


def test_a_model_of_several_files_and_folders_loads(load, tmp_path):
    (tmp_path / "parts" / "left").mkdir(parents=True)
    (tmp_path / "robots").mkdir()
    (tmp_path / "scene.xml").write_text(
        '<mujoco><compiler meshdir="parts"/><include file="robots/arm.xml"/>'
        '<worldbody><camera pos="0 -1 0" xyaxes="1 0 0 0 0 1"/></worldbody></mujoco>'
    )
    arm = (
        '<mujoco><asset><mesh name="m" file="left/cube.obj"/></asset><worldbody><body name='
        '"forearm"><joint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )

    def refused() -> str:
        with pytest.raises(InputError) as caught:
            load(HEAD + MASS)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    said = refused()
    assert re.search(r"tune\.toml:1: MuJoCo cannot read .*scene\.xml: .*'robots/arm\.xml'", said)
    assert f"it was looked for in {tmp_path}, and beside" in said
    (tmp_path / "robots" / "arm.xml").write_text(arm)
    said = refused()
    assert "left/cube.obj" in said
    assert f"it was looked for in {tmp_path}, {tmp_path / 'parts'}, and beside" in said
    (tmp_path / "parts" / "left" / "cube.obj").write_text(CUBE)
    assert load(HEAD + MASS).load_model().nmesh == 1


INERTIAL = """<inertial><mass value="1"/><origin xyz="0 0 .2"/>
  <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = """model = "arm.urdf"
control_timestep_s = 0.05
camera = { position_m = [0, -1, 0], look_at_m = [0, 0, 0] }
"""


def test_urdf_is_driven_by_added_servos(load, tmp_path):
    (tmp_path / "arm.urdf").write_text(
        f"""<robot name="arm"><link name="base"/><link name="forearm">{INERTIAL}
        <collision><geometry><mesh filename="package://arm/meshes/cube.obj"/></geometry></collision>
        </link><joint name="elbow" type="revolute"><parent link="base"/><child link="forearm"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="5" velocity="2"/></joint></robot>"""
    )
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "cube.obj").write_text(CUBE)
    task = load(URDF + "[[actuators]]\njoint = 'elbow'\nkp = 20\n" + MASS)
    model = task.load_model()
    assert (model.nu, model.nmesh) == (1, 1)
    np.testing.assert_allclose(model.actuator("elbow").ctrlrange, [-1, 2])
    run = a_run(tmp_path, task, np.array([1.5]))
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    tuned = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert (tuned.body("forearm").mass[0], tuned.nmesh, tuned.nu) == (1.5, 1, 1)


@pytest.mark.parametrize("deep", ["", "robots/arm/"])
def test_a_mesh_of_a_package_is_found_in_copies_of_the_package_s_files(tmp_path, deep, monkeypatch):
    """A run's copies, and those of a dict, begin at the folder that holds all files, or above."""
    mesh = f"package://my_desc/{deep}meshes/cube.obj"
    texts = {
        "meshes/cube.obj": CUBE,
        "urdf/arm.urdf": f"""<robot name="arm"><link name="base"/><link name="forearm">{INERTIAL}
            <visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
            <joint name="elbow" type="continuous"><parent link="base"/><child link="forearm"/>
            </joint></robot>""",
        "tune.toml": URDF.replace("arm.urdf", "urdf/arm.urdf") + MASS,
    }
    folder = tmp_path / "my_desc" / deep
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    task = load_task(str(folder / "tune.toml"))
    keep_sources(tmp_path / "run", task.files)
    (copy,) = (tmp_path / "run").rglob("tune.toml")
    monkeypatch.chdir(folder)
    declared = simtune.load_task(tomllib.loads(texts["tune.toml"]))
    (folder / "meshes" / "cube.obj").unlink()  # only the copies are left
    for again in (load_task(str(copy)), declared):
        assert again.load_model().mesh_vertnum == [4]
        assert {file.name for file in again.files} >= {"arm.urdf", "cube.obj"}


@pytest.mark.parametrize("comment", ["", '<!-- no <mujoco>,\nas <robot name="old"> had -->'])
def test_urdf_is_drawn_as_a_camera_sees_it(load, tmp_path, comment):
    """By default MuJoCo drops what is to be seen, and draws what is meant for collisions."""
    (tmp_path / "arm.urdf").write_text(
        f"""{comment}<robot name="arm"><link name="base"/><link name="forearm">{INERTIAL}
        <visual><geometry><sphere radius=".1"/></geometry></visual>
        <collision><geometry><box size=".3 .3 .3"/></geometry></collision>
        </link><link name="hand">{INERTIAL}
        <collision><geometry><box size=".1 .1 .1"/></geometry></collision></link>
        <joint name="elbow" type="revolute"><parent link="base"/><child link="forearm"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="5" velocity="2"/></joint>
        <joint name="wrist" type="revolute"><parent link="forearm"/><child link="hand"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="5" velocity="2"/></joint></robot>"""
    )
    text = URDF + "[[actuators]]\njoint = 'elbow'\nkp = 20\ntorque_limit = 9\n"
    text += "[[actuators]]\njoint = 'wrist'\nkp = 20\n" + MASS
    text += "[[parameters]]\nname = 'limit'\nkind = 'torque_limit'\nobjects = 'wrist'\n"
    task = load(text)
    model = task.load_model()
    sphere, box = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
    shown = {(int(k), int(g)) for k, g in zip(model.geom_type, model.geom_group, strict=True)}
    assert shown == {(sphere, 1), (box, 3), (box, 0)}
    # A servo's limit replaces URDF's effort, which is what a parameter begins with
    assert not model.jnt_actfrclimited.any()
    assert task.parameters["limit"].nominal == 5
    np.testing.assert_allclose(model.actuator_forcerange, [[-9, 9], [-5, 5]])


def test_what_is_exported_of_a_model_without_names_has_them_and_its_script_gives_them(
    load, tmp_path
):
    text = '[[parameters]]\nname = "p"\nkind = "gain"\nobjects = "actuator 1"\n'
    task = load(HEAD + text)
    out = export(
        ExportConfig(run_folder=a_run(tmp_path, task, np.array([7.0])), out=tmp_path / "out")
    )
    assert (
        mujoco.MjModel.from_xml_path(str(out / "model.xml")).actuator("actuator 1").gainprm[0] == 7
    )
    copy = tmp_path / "copy.xml"
    script = [sys.executable, str(out / "apply.py"), str(tmp_path / "scene.xml"), str(copy)]
    subprocess.run(script, check=True)
    assert mujoco.MjModel.from_xml_path(str(copy)).actuator_gainprm[1, 0] == 7
