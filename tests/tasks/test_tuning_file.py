"""Tuning files: the documentation's examples, what is made of each table, and every complaint."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch
from search_context import context_of

from simtune.checking import check
from simtune.checking.recording_warnings import recording_warnings
from simtune.config import CheckConfig, RealConfig
from simtune.errors import InputError, UnknownName
from simtune.parameters import ModelWriter, Parameter, ParameterSpace
from simtune.parameters.fields import KINDS
from simtune.real.choose import choose_real
from simtune.recordings import write_dataset
from simtune.simulation import DirectActions, MocapActions, ScaledActions, random_actions
from simtune.tasks import Task, load_any_task, load_task, named_files
from simtune.tasks.tuning_file import load as loading
from simtune.tasks.tuning_file import parameters as reading
from simtune.tasks.tuning_file import policy as policies
from simtune.toml_reading.lines import key_lines
from simtune.trajectory import Trajectory
from simtune.tuning.posterior import PosteriorSearch

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "cart_pendulum" / "tune.toml"
BALL = ROOT / "examples" / "bouncing_ball"
SCENE = """
<mujoco>
  <option timestep="0.005"/>
  <asset>
    <material name="blue" rgba="0.1 0.2 0.7 1"/>
  </asset>
  <worldbody>
    <light name="lamp" diffuse="0.4 0.4 0.4"/>
    <light name="bulb" diffuse="0.4 0.4 0.4"/>
    <light name="red" diffuse="0.9 0.1 0.1"/>
    <camera name="front" pos="0.1 -2 0.5" xyaxes="1 0 0 0 0 1" fovy="50"/>
    <geom name="ground" type="plane" size="2 2 0.1" material="blue"/>
    <site name="dot" size="0.02" material="blue"/>
    <body name="target" mocap="true" pos="0.7 0 0.5"/>
    <body name="upper" pos="0 0 0.5">
      <joint name="shoulder" axis="0 1 0" damping="0.5" range="-90 90" limited="true"/>
      <geom name="upper" type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.2"/>
        <geom name="lower" type="capsule" size="0.02" fromto="0 0 0 0.4 0 0" mass="0.5"
              rgba="0.7 0.1 0.2 1"/>
        <body name="bob" pos="0.4 0 0">
          <geom name="bob" size="0.04" mass="0.2" rgba="0.7 0.1 0.2 1"/>
        </body>
      </body>
    </body>
    <body name="block" pos="0 0.25 0.05">
      <freejoint name="block"/>
      <geom name="block" type="box" size="0.05 0.05 0.05" mass="0.3" material="blue"/>
    </body>
    <body name="sled" pos="0 -0.4 0.3">
      <joint name="sled" type="slide" axis="1 0 0" armature="0.1"/>
      <geom name="sled" type="box" size="0.02 0.03 0.04" mass="0.3"/>
      <body pos="0 0 -0.1">
        <joint name="ball" type="ball"/>
        <geom size="0.02" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <equality><weld body1="target" body2="bob"/></equality>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="20" kv="1" ctrllimited="true" ctrlrange="-1 2"/>
    <velocity name="elbow" joint="elbow" kv="3" ctrllimited="true" ctrlrange="-1 1"/>
    <motor name="sled" joint="sled" gear="4"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0.3 0.2  0 0.25 0.05 1 0 0 0  0.1  1 0 0 0" ctrl="0.3 0 0.5"
         mpos="0.7 0 0.5"/>
    <key name="away" qpos="0 0  0 0.25 0.05 1 0 0 0  0  1 0 0 0"/>
  </keyframe>
</mujoco>
"""
PLANAR = """
<mujoco>
  <worldbody>
    <camera name="top" pos="0 0 2"/>
    <body name="bob">
      <joint name="pusher_x" type="slide" axis="1 0 0"/>
      <joint name="pusher_y" type="slide" axis="0 1 0"/>
      <geom size="0.015" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <position name="x" joint="pusher_x" kp="50" kv="10"/>
    <position name="y" joint="pusher_y" kp="50" kv="10"/>
  </actuator>
</mujoco>
"""
HOSE = """
<body name="hose_0" pos="2 0 1"><joint type="ball" stiffness="1"/><geom size="0.01"/>
  <body name="hose_1" pos="0 0 -0.1"><joint type="ball" stiffness="1"/><geom size="0.01"/></body>
</body>
"""
CALIBRATION = """{image_width: 96, image_height: 64, dist_coeffs: [0, 0, 0, 0, 0],
camera_matrix: [[80, 0, 47.5], [0, 80, 31.5], [0, 0, 1]]}
"""
HEAD = 'model = "scene.xml"\ncontrol_timestep_s = 0.05\n'
MASS = '[[parameters]]\nname = "m"\nkind = "mass"\nobjects = "bob"\n'


@pytest.fixture
def declare(load):
    """The parameters of a file with some tables [[parameters]]."""

    def declare(text: str) -> ParameterSpace:
        return load(f"{HEAD}[[parameters]]\n{text}").parameters

    return declare


# --- examples -------------------------------------------------------------------------------


def documented(language: str) -> list[str]:
    text = (ROOT / "docs" / "tuning-file.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


@pytest.mark.parametrize("block", documented("toml"))
def test_every_example_in_the_documentation_loads(load, folder, block, tmp_path):
    if block.startswith("environment"):
        (tmp_path / "env.py").write_text((BALL / "env.py").read_text())
        (tmp_path / "tune.toml").write_text(block)
        assert len(load_any_task(str(tmp_path / "tune.toml")).simulator(image_size=16).points())
        return
    of_built_in = block.startswith("task =")
    head = "" if "model =" in block or of_built_in else HEAD
    if block.startswith("[policy]"):
        (folder / "policy.py").write_text(documented("python")[0])
    if 'mapping = "joints"' in block:  # which needs servos of positions
        servos = SCENE.replace(
            '<velocity name="elbow" joint="elbow" kv', '<position name="elbow" joint="elbow" kp'
        )
        (folder / "scene.xml").write_text(servos)
    if "hose_*" in block:
        (folder / "scene.xml").write_text(SCENE.replace("<worldbody>", f"<worldbody>{HOSE}"))
    if "pusher_x" in block:
        (folder / "scene.xml").write_text(PLANAR)
    if "[[cameras]]" in block:
        more = "".join(f'<camera name="{name}" pos="0 0 3"/>' for name in ("top", "hand_camera"))
        (folder / "scene.xml").write_text(SCENE.replace("<camera", f"{more}<camera", 1))
        (folder / "wrist.yaml").write_text(CALIBRATION)
    has_parameters = of_built_in or "[[parameters]]" in block
    task = load(head + block + ("" if has_parameters else MASS))
    assert len(task.parameters) >= 1
    batch = Batch(task.load_model(), 8, 1)
    task.initialize(batch, np.random.default_rng(0))
    assert np.isfinite(batch.state).all()


def test_all_kinds_and_keys_are_documented():
    text = (ROOT / "docs" / "tuning-file.md").read_text(encoding="utf-8")
    for word in (*KINDS, *reading._NUMBERS, *loading._KEYS, *policies._KEYS):
        assert f"`{word}`" in text or f"[[{word}]]" in text or f"`[{word}]`" in text, word


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_documented_with_its_field(kind):
    text = (ROOT / "docs" / "tuning-file.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\|[^|]*`{kind}`[^|]*\|.*", text.partition("| kind | what |")[2], re.M)
    field = KINDS[kind][0].name
    assert f"`{field}`" in row or (field == kind and "as named" in row)


def test_the_example_scene_moves_and_is_lit():
    task = load_task(str(EXAMPLE))
    assert (task.name, task.cameras[0].camera, task.step_s) == ("cart_pendulum", "front", 0.05)
    simulator = task.simulator(image_size=64)
    rng = np.random.default_rng(0)
    actions = random_actions(4, 100, simulator.action_mapping, rng)
    worlds = np.tile(task.parameters.nominal, (4, 1))
    rollouts = simulator.roll_out(worlds, actions, rng)
    assert len(rollouts) == 4
    moved = rollouts.states[:, :, 1 : 1 + simulator.model.nq].std((0, 1))
    assert (moved > 0.05).all()
    frames = simulator.render(rollouts.states[:, 0], worlds)
    assert 60 < frames.mean() < 200


# --- the file itself ------------------------------------------------------------------------


def test_a_short_file_has_usual_values(load, tmp_path):
    task = load(HEAD + MASS)
    assert (task.name, task.cameras[0].camera, task.episode_steps) == (tmp_path.name, "front", 200)
    assert (task.control_timestep_s, task.action_repeat) == (0.05, 1)
    assert task.reward is None
    assert isinstance(task.load_actions(), DirectActions)
    simulator = task.simulator(image_size=16)
    assert (simulator.step_s, simulator.num_substeps, simulator.num_actions) == (0.05, 10, 3)


@pytest.fixture
def declared(tmp_path):
    """Loads a tuning file of this text alone."""

    def declared(text: str) -> Task:
        (tmp_path / "other.toml").write_text(text)
        return load_task(str(tmp_path / "other.toml"))

    return declared


def test_a_built_in_task_is_the_same_with_another_background(declared):
    own = load_task("ball_in_cup")
    same = declared('task = "ball_in_cup"')
    assert repr(list(same.parameters)) == repr(list(own.parameters))
    assert [camera.camera for camera in same.cameras] == ["cam0"]
    assert (same.step_s, same.looks_at) == (own.step_s, own.looks_at)
    assert same.content_hash != own.content_hash  # another file's run does not go on with it
    rng, worlds = np.random.default_rng(0), own.parameters.nominal[None]
    actions = np.ones((1, 5, 2))
    both = [task.simulator(image_size=16) for task in (own, same)]
    states = [simulator.roll_out(worlds, actions, rng).states[:, 1:] for simulator in both]
    assert states[0].shape == states[1].shape
    begun = both[0].begin(worlds, rng).states[:, 0]
    np.testing.assert_array_equal(*(simulator.render(begun, worlds) for simulator in both))
    assert same.reward is own.reward


@pytest.mark.parametrize(
    ("task", "background", "left_out"),
    [("ball_in_cup", "recording", "ground"), ("cheetah", "unknown", "ground")],
)
def test_colours_of_what_stands_still_are_no_parameters_before_a_background(
    declared, task, background, left_out
):
    made = declared(f'task = "{task}"\n[camera]\nbackground = "{background}"')
    own = load_task(task).parameters.names
    assert made.parameters.names == tuple(n for n in own if not n.startswith(left_out))
    assert made.cameras[0].background == background


def test_a_built_in_task_may_have_other_parameters_and_another_camera(declared):
    made = declared("""
task = "walker"
name = "mine"
camera = "back"

[[parameters]]
name = "knees"
kind = "damping"
objects = ["right_knee", "left_knee"]
nominal = 1.0
""")
    assert (made.name, made.parameters.names) == ("mine", ("knees",))
    assert made.cameras[0].camera == "back"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('task = "walkre"', "did you mean 'walker'"),
        ('task = "walker"\nepisode_steps = 3', "episode_steps"),
        ('task = "walker"\ncamera = "front"', "no camera 'front' in the model"),
    ],
)
def test_what_is_wrong_with_a_built_in_task_that_is_changed(declared, text, message):
    with pytest.raises(InputError, match=message):
        declared(text)


def test_a_long_file_says_it_all(load, tmp_path):
    top = 'name = "bench"\ndescription = "d"\naction_repeat = 2\nepisode_steps = 40\n'
    task = load(HEAD + top + MASS)
    assert (task.name, task.description, task.step_s) == ("bench", "d", 0.1)
    assert task.episode_steps == 40


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("model = 'scene.xml'\ncontrol = \n", 2, "not valid TOML: Invalid value: control ="),
        ("a = 1\n[x\n", 2, "not valid TOML"),
        ("a = 1\nb = 'x\n\n", 2, "not valid TOML"),
        ("a = 1\na = 2\n", 2, "not valid TOML: Cannot overwrite"),
        (HEAD + "modl = 3\n" + MASS, 3, "no key 'modl' in the file; did you mean 'model'?"),
        (HEAD + MASS.replace("parameters", "parameter"), 3, "no key 'parameter' in the file"),
        ("control_timestep_s = 1\n" + MASS, 1, "the file has no model: expected a text"),
        ("model = 'scene.xml'\n" + MASS, 1, "no control_timestep_s: expected a finite number"),
        ("\nmodel = 'no.xml'\n", 2, r"there is no model file .*no\.xml"),
        ("model = 3\n", 1, "model must be a text, got 3"),
        ("model = 'scene.xml'\ncontrol_timestep_s = 0\n" + MASS, 2, "number above 0, got 0"),
        ("model = 'scene.xml'\ncontrol_timestep_s = true\n" + MASS, 2, "number .*got true"),
        ("model = 'scene.xml'\ncontrol_timestep_s = nan\n" + MASS, 2, "finite number .*got nan"),
        (HEAD + "action_repeat = 1.5\n" + MASS, 3, "action_repeat must be a whole number .*1.5"),
        (HEAD + "episode_steps = 0\n" + MASS, 3, "episode_steps must be a whole number of at"),
        (HEAD + "episode_steps = 200_000\n" + MASS, 3, "at least 1 and at most 100000"),
        ("model = 'scene.xml'\ncontrol_timestep_s = 1e-9\n" + MASS, 2, "is it in seconds?"),
        ("model = 'scene.xml'\ncontrol_timestep_s = .1\n", 2, r"= .1 \(numbers begin with a digit"),
        (
            HEAD + "[[parameters]]\nname = 'p'\nkind = 'colour'\nobjects = 'bob'\nknown = true\n",
            3,
            "nothing to tune: all parameters are known",
        ),
        (HEAD, 1, r"nothing to tune.*\[\[parameters\]\]"),
        (HEAD + "parameters = 3\n", 3, r"tables, each after a line \[\[parameters\]\], got 3"),
        (HEAD + "[parameters]\nname = 'x'\n", 3, r"tables, each after .*got a table"),
        (HEAD + "actions = 3\n" + MASS, 3, "actions must be a table, got 3"),
    ],
)
def test_what_is_wrong_with_the_file(refuses, text, line, message):
    refuses(text, line, message)


def test_a_whole_number_beyond_64_bits_is_a_number(declare):
    huge = f"name = 'k'\nkind = 'mass'\nobjects = 'bob'\nnominal = {10**30}\n"
    (parameter,) = declare(huge)
    assert parameter.nominal == 1e30


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        ("<mujoco><worldbod/></mujoco>", "cannot read .*bad.xml: .*'worldbod', line 1"),
        ("hello", "cannot read .*bad.xml: XML parse error"),
        ("<mujocoinclude/>", "cannot read .*bad.xml: it is a part that other models include"),
        (
            "<mujoco><worldbody><body name='b'><joint/></body></worldbody></mujoco>",
            "cannot compile bad.xml: .*mass and inertia of moving bodies",
        ),
        (
            "<mujoco><asset><mesh name='a' file='no.obj'/></asset><worldbody>"
            "<geom type='mesh' mesh='a'/><camera name='c'/></worldbody></mujoco>",
            "cannot compile bad.xml: .*no.obj",
        ),
    ],
)
def test_a_model_that_mujoco_refuses(folder, refuses, xml, message):
    camera = "<camera name='c'/></worldbody>"
    (folder / "bad.xml").write_text(
        xml.replace("</worldbody>", camera) if "camera" not in xml else xml
    )
    refuses('control_timestep_s = 0.05\nmodel = "bad.xml"\n' + MASS, 2, message)


def test_a_model_that_is_no_file_is_told_in_one_line(refuses):
    for name, message in (
        ("<mujoco>\\n</mujoco>", "XML text: give a file, or mujoco.MjSpec.from_string"),
        (300 * "a", "there is no model file"),
    ):
        refuses(f'control_timestep_s = 0.05\nmodel = "{name}"\n' + MASS, 2, message)


def test_a_xacro_is_to_be_run_first(folder, refuses):
    (folder / "arm.urdf.xacro").touch()
    refuses('model = "arm.urdf.xacro"\n' + MASS, 1, "no model yet: run xacro on it, and give")


def test_files_that_cannot_be_read(folder):
    with pytest.raises(InputError, match=r"^cannot read .*no\.toml: No such file"):
        load_task(str(folder / "no.toml"))
    (folder / "bad.toml").write_bytes(b"a = '\xff'")
    with pytest.raises(InputError, match=r"bad\.toml is no text in UTF-8"):
        load_task(str(folder / "bad.toml"))
    with pytest.raises(InputError, match=r"scene\.xml is a model: give a tuning file"):
        load_task(str(folder / "scene.xml"))
    with pytest.raises(UnknownName, match="no task 'walkr'"):
        load_task("walkr")


def test_lines_of_keys():
    text = """a = [
  1,
]
# [[no]]
s = '''
[[fake]]
k = 1
'''
b.c = { d = 1 }

[[p]]
name = "x"
[p.sub]
k = 2
[[p]]
[[p.list]]
[[p.list]]
k = 3
"""
    lines = key_lines(text)
    expected = {
        ("a",): 1,
        ("s",): 5,
        ("b", "c", "d"): 9,
        ("p", 0): 11,
        ("p", 0, "name"): 12,
        ("p", 0, "sub", "k"): 14,
        ("p", 1): 15,
        ("p", 1, "list", 0): 16,
        ("p", 1, "list", 1, "k"): 18,
    }
    assert {path: lines[path] for path in expected} == expected
    assert ("fake", 0) not in lines


# --- camera ---------------------------------------------------------------------------------


def camera_of(task: Task) -> tuple[np.ndarray, np.ndarray, float]:
    """Place, axes (right, up, backward) in rows, field of view."""
    model = task.load_model()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = model.camera(task.cameras[0].camera).id
    return data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3).T, model.cam_fovy[camera]


def test_a_camera_of_its_own(load):
    pose = "[camera]\nposition_m = [1, -2, 3]\nlook_at_m = [0, 0, 1]\nfield_of_view_deg = 30\n"
    place, (right, up, backward), fovy = camera_of(load(HEAD + pose + MASS))
    np.testing.assert_allclose(place, [1, -2, 3])
    np.testing.assert_allclose(backward, np.array([1, -2, 2]) / 3, atol=1e-12)
    assert fovy == 30
    assert right[2] == pytest.approx(0)
    assert up[2] > 0


def test_a_camera_that_was_turned_or_looks_down(load):
    pose = "[camera]\nposition_m = [0, 0, 3]\nlook_at_m = [0, 0, 0]\nup = [1, 0, 0]\n"
    _, axes, fovy = camera_of(load(HEAD + pose + MASS))
    np.testing.assert_allclose(axes, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    assert fovy == 45
    quat = "[camera]\nposition_m = [0, 0, 3]\nquat = [2, 0, 0, 0]\n"
    _, axes, _ = camera_of(load(HEAD + quat + MASS))
    np.testing.assert_allclose(axes, np.eye(3), atol=1e-12)


def test_the_pose_of_a_camera_of_its_own_can_be_a_parameter(load):
    pose = "[camera]\nposition_m = [0, -2, 1]\nlook_at_m = [0, 0, 0.5]\n"
    tuned = '[[parameters]]\nname = "c"\nkind = "camera_pose"\nwithin_m = 0.2\nwithin_rad = 0.3\n'
    tuned += '[[parameters]]\nname = "f"\nkind = "field_of_view"\n'
    space = load(HEAD + pose + tuned).parameters
    axes = ("x", "y", "z", "pitch", "yaw", "roll")
    assert space.names == (*(f"c_{axis}" for axis in axes), "f")
    np.testing.assert_allclose(space.nominal, [0, -2, 1, 0, 0, 0, 45])
    np.testing.assert_allclose(space.high - space.nominal, [0.2] * 3 + [0.3] * 3 + [10])


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ('camera = "frnt"\n', 3, "no camera 'frnt' in the model; did you mean 'front'?"),
        ("camera = 3\n", 3, "camera must be a text, got 3"),
        ("[camera]\nlook_at_m = [0, 0, 0]\n", 3, r"\[camera\] has no position_m: expected 3 fin"),
        ("[camera]\nposition_m = [0, 0, 1]\n", 3, "expected look_at_m, .* or quat"),
        ("[camera]\nposition_m = [0, 0]\n", 4, r"position_m must be 3 finite numbers.*\[0, 0\]"),
        ("[camera]\npos = [0, 0, 1]\n", 4, "no key .pos. in?"),
        (
            "[camera]\nposition_m = [0, 0, 1]\nlook_at_m = [0, 0, 1]\n",
            5,
            "cannot look at where it is",
        ),
        ("[camera]\nposition_m = [0, 0, 1]\nlook_at_m = [0, 0, 0]\n", 5, "looks along up"),
        (
            "[camera]\nposition_m = [0, 0, 1]\nlook_at_m = [1, 0, 0]\nup = [0, 0, 0]\n",
            6,
            "looks along up",
        ),
        (
            "[camera]\nposition_m = [0, 0, 1]\nlook_at_m = [1, 0, 0]\nfield_of_view_deg = 180\n",
            6,
            "must be a finite number above 0 and below 180",
        ),
        (
            "[camera]\nposition_m = [0, 0, 1]\nlook_at_m = [1, 0, 0]\nfield_of_view_deg = 0.8\n",
            6,
            "is in degrees, got 0.8; in radians that would be 46 degrees",
        ),
        ("[camera]\nposition_m = [0, 0, 1]\nquat = [0, 0, 0, 0]\n", 5, "must not be zero"),
        (
            "[camera]\nposition_m = [0, 0, 1]\nquat = [1, 0, 0, 0]\nup = [1, 0, 0]\n",
            5,
            "not both",
        ),
    ],
)
def test_what_is_wrong_with_a_camera(refuses, text, line, message):
    refuses(HEAD + text + MASS, line, message)


def test_a_table_without_a_camera_means_the_models_only_one(load, folder):
    xml = '<mujoco><worldbody><camera name="c"/><body name="bob"><joint/><geom size=".1"/></body>'
    (folder / "scene.xml").write_text(xml + "</worldbody></mujoco>")
    (footage,) = load(HEAD + '[camera]\nbackground = "recording"\n' + MASS).cameras
    assert (footage.camera, footage.name, footage.background) == ("c", "c", "recording")


def test_models_with_other_numbers_of_cameras(folder, refuses):
    pose = r"or say where one is in a table \[camera\]"
    for count, message in (
        (0, f"no camera films: the model has none with a name; give it one, {pose}"),
        (2, f"which camera films\\? camera = one of c0, c1, {pose}"),
    ):
        cameras = "".join(f'<camera name="c{i}"/>' for i in range(count))
        xml = f"<mujoco><worldbody>{cameras}</worldbody></mujoco>"
        (folder / "scene.xml").write_text(xml)
        refuses(HEAD + MASS, 1, message)
    (folder / "scene.xml").write_text("<mujoco/>")
    refuses(HEAD + "camera = 'c'\n" + MASS, 3, "no camera 'c' in the model, which has none")


# --- actions --------------------------------------------------------------------------------


def test_actions_are_made_for_the_model(load):
    text = "[actions]\nmapping = 'scaled'\nactuators = ['shoulder', 'elbow']\nrange = [-100, 100]\n"
    mapping = load(HEAD + text + MASS).load_actions()
    assert isinstance(mapping, ScaledActions)
    batch = Batch(mujoco.MjModel.from_xml_string(SCENE), 1, 1)
    controls = mapping.apply(batch, np.array([[-100.0, 50.0]]))
    np.testing.assert_allclose(controls, [[-1, 0.5, 0]])
    text = "[actions]\nmapping = 'mocap'\nbody = 'target'\naxes = 'xz'\nmetres_per_unit = 0.02\n"
    mapping = load(HEAD + text + MASS).load_actions()
    assert isinstance(mapping, MocapActions)
    assert mapping.names == ("target x", "target z")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("mapping = 'scale'\n", 4, r"no mapping 'scale' in \[actions\]; did you mean 'scaled'?"),
        ("gain = 3\n", 4, r"no key 'gain' in \[actions\]"),
        ("actuators = ['elbo']\n", 4, "no actuator 'elbo' in the model; did you mean 'elbow'?"),
        ("actuators = []\n", 4, "actuators must be a name or a list of names"),
        ("actuators = ['elbow', 3]\n", 4, "actuators must be a name or a list of names"),
        ("mapping = 'scaled'\n", 3, "sled has no ctrlrange"),
        ("mapping = 'scaled'\ngain = [1, 2]\n", 3, "gain must be a number, or 3 of them"),
        ("mapping = 'scaled'\ngain = 'x'\n", 5, "gain must be a number or a list of numbers"),
        ("mapping = 'scaled'\ngain = []\n", 5, "gain must be a number or a list of numbers"),
        ("mapping = 'scaled'\noffset = 1\n", 5, "offset needs gain"),
        ("mapping = 'scaled'\ngain = 1\nrange = [[0, 1], [0]]\n", 3, r"range \[low, high\]"),
        ("mapping = 'mocap'\n", 3, r"\[actions\] has no body"),
        ("mapping = 'mocap'\nbody = 'targt'\n", 3, "no mocap body 'targt'.*'target'"),
        ("mapping = 'mocap'\nbody = 'target'\naxes = 'xw'\n", 3, "axes must be some of x, y and z"),
        ("mapping = 'mocap'\nbody = 'target'\nworkspace_m = [0, 1, 2]\n", 3, "or 3 of them"),
    ],
)
def test_what_is_wrong_with_actions(refuses, text, line, message):
    refuses(HEAD + "[actions]\n" + text + MASS, line, message)


# --- initial state --------------------------------------------------------------------------


def starts(task: Task, num: int = 400) -> Batch:
    batch = Batch(task.load_model(), num, 1)
    batch.qpos[:], batch.qvel[:], batch.time[:] = 1, 1, 7  # of an episode before
    task.initialize(batch, np.random.default_rng(0))
    assert (batch.time == 0).all()
    return batch


def spans(batch: Batch, joint: str, count: int = 1) -> np.ndarray:
    """(count, 2) the least and the largest of a joint's first numbers."""
    at = int(batch.model.joint(joint).qposadr[0])
    values = batch.qpos[:, at : at + count]
    return np.stack([values.min(0), values.max(0)], axis=1)


def test_recordings_may_start_wherever_joints_go(load):
    batch = starts(load(HEAD + "[initial_state]\nkeyframe = 'home'\n" + MASS))
    np.testing.assert_allclose(spans(batch, "shoulder"), [[-np.pi / 2, np.pi / 2]], atol=0.1)
    np.testing.assert_allclose(spans(batch, "elbow"), [[0.2 - np.pi, 0.2 + np.pi]], atol=0.1)
    near = 0.1 * batch.model.stat.extent
    np.testing.assert_allclose(spans(batch, "sled"), [[0.1 - near, 0.1 + near]], atol=0.05 * near)
    block = spans(batch, "block", 3)
    np.testing.assert_allclose(
        block, [[-near, near], [0.25 - near, 0.25 + near], [0.05, 0.05]], atol=0.05 * near
    )
    assert (batch.qvel == 0).all()
    np.testing.assert_array_equal(batch.ctrl, np.tile([0.3, 0, 0.5], (400, 1)))


@pytest.mark.parametrize("are_off", [False, True])
def test_tied_joints_start_as_the_model_has_them_unless_no_tie_acts(folder, load, are_off):
    tie = '<equality><joint joint1="elbow" joint2="shoulder"/>'
    scene = SCENE.replace("<equality>", tie)
    if are_off:
        scene = scene.replace("  <asset>", '<option><flag equality="disable"/></option><asset>', 1)
    (folder / "scene.xml").write_text(scene)
    batch = starts(load(HEAD + MASS), 5)
    assert [np.ptp(batch.qpos[:, joint]) > 0.1 for joint in (0, 1)] == [are_off, are_off]


def test_starts_have_no_new_contacts(load):
    task = load(HEAD + MASS)
    batch = starts(task)
    pose = mujoco.MjData(batch.model)
    mujoco.mj_forward(batch.model, pose)
    assert pose.ncon > 0  # the block lies on the ground
    assert (batch.bind("ncon") <= pose.ncon).all()


def test_a_distribution(load):
    text = """[initial_state]
kind = "distribution"
keyframe = "home"
[initial_state.joints]
shoulder = { position = [-0.5, -0.4], velocity = [1, 2] }
block = { position = [[0.1, 0.2], [0.25, 0.25], [0.05, 0.06]], turn = [-0.1, 0.3] }
"""
    batch = starts(load(HEAD + text + MASS))
    np.testing.assert_allclose(spans(batch, "shoulder"), [[-0.5, -0.4]], atol=0.002)
    np.testing.assert_array_equal(spans(batch, "elbow"), [[0.2, 0.2]])
    expected = [[0.1, 0.2], [0.25, 0.25], [0.05, 0.06]]
    np.testing.assert_allclose(spans(batch, "block", 3), expected, atol=0.002)
    quaternions = batch.qpos[:, 5:9]
    angle = 2 * np.arctan2(quaternions[:, 3], quaternions[:, 0])
    assert (angle.min(), angle.max()) == (
        pytest.approx(-0.1, abs=0.01),
        pytest.approx(0.3, abs=0.01),
    )
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1)
    speed = batch.qvel[:, 0]
    assert (speed.min(), speed.max()) == (pytest.approx(1, abs=0.01), pytest.approx(2, abs=0.01))
    assert (batch.qvel[:, 1:] == 0).all()


def test_a_keyframe(load):
    task = load(HEAD + "[initial_state]\nkind = 'keyframe'\nkeyframe = 'home'\n" + MASS)
    batch = starts(task, 5)
    np.testing.assert_array_equal(batch.qpos, np.tile(task.load_model().key("home").qpos, (5, 1)))
    assert (batch.qvel == 0).all()


def test_starts_that_always_touch(folder, load):
    text = """[initial_state]
kind = "distribution"
[initial_state.joints]
block = { position = [[0.0, 0.0], [0.25, 0.25], [0.01, 0.02]], turn = [0, 0] }
sled = { position = [0.0, 0.0] }
shoulder = { position = [1.5, 1.57] }
"""
    task = load(HEAD + text + MASS)
    batch = Batch(task.load_model(), 3, 1)
    place = re.escape(f"{folder / 'tune.toml'}:3: ")
    with pytest.raises(InputError, match=f"^{place}.*touch.*may_touch = true"):
        task.initialize(batch, np.random.default_rng(0))
    task = load(
        HEAD + text.replace("[initial_state]\n", "[initial_state]\nmay_touch = true\n") + MASS
    )
    task.initialize(batch, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("kind = 'recoding'\n", 4, r"no kind 'recoding' in \[initial_state\].*'recording'"),
        ("kind = 'keyframe'\n", 4, 'kind = "keyframe" needs keyframe = NAME'),
        ("keyframe = 'hom'\n", 4, "no keyframe 'hom' in the model; did you mean 'home'?"),
        ("may_touch = 1\n", 4, "may_touch must be true or false, got 1"),
        ("joints.shoulder.position = [0, 1]\n", 4, 'joints go with kind = "distribution" only'),
        ("kind = 'distribution'\njoints.shoudler.position = [0, 1]\n", 5, "no joint 'shoudler'"),
        ("kind = 'distribution'\njoints.shoulder = 3\n", 5, "shoulder must be a table, got 3"),
        (
            "kind = 'distribution'\njoints.elbow.position = [1, 0]\n",
            5,
            "two numbers, the lower one first",
        ),
        ("kind = 'distribution'\njoints.elbow.turn = [0, 1]\n", 5, "no key 'turn' in"),
        (
            "kind = 'distribution'\njoints.shoulder.position = [-90, 90]\n",
            5,
            r"joint's range, -1.571 to 1.571 \(rad or m\), got -90 to 90",
        ),
        (
            "kind = 'distribution'\njoints.block.position = [0, 1]\n",
            5,
            "3 pairs, the lower number first",
        ),
        (
            "kind = 'distribution'\njoints.block.turn = [-180, 180]\n",
            5,
            "turn is in rad, .* got -180 to 180; if those are degrees, write -3.142 and 3.142",
        ),
        ("kind = 'distribution'\njoints.ball.position = [0, 1]\n", 5, "ball is a ball joint"),
    ],
)
def test_what_is_wrong_with_an_initial_state(refuses, text, line, message):
    refuses(HEAD + "[initial_state]\n" + text + MASS, line, message)


# --- parameters -----------------------------------------------------------------------------


def numbers(parameter: Parameter) -> tuple:
    return parameter.nominal, parameter.low, parameter.high, parameter.scale, parameter.unit


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("kind = 'mass'\nobjects = 'bob'", (0.2, 0.02, 2.0, "log", "kg")),
        ("kind = 'mass'\nobjects = ['upper', 'lower']", (1.0, 0.1, 10.0, "log", "×")),
        ("kind = 'damping'\nobjects = 'elbow'", (0.2, 0.02, 2.0, "log", "N·m·s/rad")),
        ("kind = 'armature'\nobjects = 'sled'", (0.1, 0.01, 1.0, "log", "kg")),
        ("kind = 'friction'\nobjects = 'block'", (1.0, 0.1, 10.0, "log", "1")),
        ("kind = 'size'\nobjects = 'bob'\ncomponent = 0", (0.04, 0.004, 0.4, "log", "m")),
        (
            "kind = 'center_of_mass'\nobjects = 'bob'\ncomponent = 2",
            (0.0, -0.05, 0.05, "linear", "m"),
        ),
        (  # not above the sum of the other two
            "field = 'body_inertia'\nobjects = 'bob'\ncomponent = 0",
            (1.28e-4, 1.28e-5, 2.56e-4 * (1 - 1e-5), "log", "1"),
        ),
        ("kind = 'gain'\nobjects = 'shoulder'", (20.0, 2.0, 200.0, "log", "N·m/rad")),
        ("kind = 'gear'\nobjects = 'sled'\nunit = 'N'", (4.0, 0.4, 40.0, "log", "N")),
        ("kind = 'delay'\nobjects = 'sled'\nhigh = 0.1", (0.0, 0.0, 0.1, "linear", "s")),
        ("kind = 'light'\nobjects = ['lamp', 'bulb']", (0.4, 0.0, 1.0, "linear", "1")),
        ("kind = 'light'\nobjects = 'red'\nnominal = 0.4", (0.4, 0.0, 1.0, "linear", "1")),
        ("kind = 'field_of_view'", (50.0, 40.0, 60.0, "linear", "°")),
        (
            "kind = 'mass'\nobjects = 'bob'\nnominal = 1\nlow = 0.5\nhigh = 3",
            (1, 0.5, 3, "log", "kg"),
        ),
        (
            "kind = 'stiffness'\nobjects = 'elbow'\nlow = 0\nhigh = 3",
            (0.0, 0.0, 3.0, "linear", "N·m/rad"),
        ),
        (
            "kind = 'mass'\nobjects = 'bob'\nscale = 'linear'",
            (0.2, 0.02, 2.0, "linear", "kg"),
        ),
        (
            "field = 'opt.gravity'\ncomponent = 2\nlow = -10\nhigh = -9",
            (-9.81, -10.0, -9.0, "linear", "m/s²"),
        ),
        ("field = 'cam_pos'\nobjects = 'front'\ncomponent = 0", (0.1, 0.0, 0.2, "linear", "m")),
        (
            "field = 'body_quat'\nobjects = 'sled'\ncomponent = 1",
            (0.0, -0.1, 0.1, "linear", "rad"),
        ),
        (
            "field = 'body_pos'\nobjects = 'lower'\ncomponent = 0\nlow = 0.2\nhigh = 0.4",
            (0.3, 0.2, 0.4, "linear", "m"),
        ),
    ],
)
def test_a_parameter_in_few_words(declare, text, expected):
    space = declare(f"name = 'p'\n{text}\n")
    assert space.names == ("p",)
    got = numbers(space["p"])
    assert got[3:] == expected[3:]
    np.testing.assert_allclose(got[:3], expected[:3], rtol=1e-9)


def test_colours(declare):
    space = declare("name = 'c'\nkind = 'colour'\nobjects = ['lower', 'bob']\n")
    assert space.names == ("c_r", "c_g", "c_b")
    np.testing.assert_array_equal(space.nominal, [0.7, 0.1, 0.2])
    painted = declare("name = 'c'\nkind = 'colour'\nobjects = ['block', 'ground']\n")
    np.testing.assert_array_equal(painted.nominal, [0.1, 0.2, 0.7])  # the material's
    dots = declare("name = 'c'\nfield = 'site_rgba'\nobjects = 'dot'\ncomponent = 2\n")
    np.testing.assert_array_equal(dots.nominal, [0.7])  # of a site, too
    material = declare("name = 'c'\nkind = 'material_colour'\nobjects = 'blue'\n")
    np.testing.assert_array_equal(material.nominal, [0.1, 0.2, 0.7])
    assert {p.field for p in material} == {"mat_rgba"}
    text = "name = 'c'\nkind = 'colour'\nobjects = ['bob', 'block']\nnominal = [0, 0.5, 1]\n"
    np.testing.assert_array_equal(declare(text).nominal, [0, 0.5, 1])


def test_nominal_is_the_models_own(load):
    """Written back, nothing changes."""
    text = MASS
    for name, kind, objects in (
        ("damping", "damping", ["shoulder", "elbow"]),
        ("gain", "gain", ["shoulder", "elbow"]),
        ("colour", "colour", ["block"]),
        ("light", "light", ["lamp", "bulb"]),
        ("view", "camera_pose", ["front"]),
    ):
        text += f'[[parameters]]\nname = "{name}"\nkind = "{kind}"\nobjects = {objects}\n'
    task = load(HEAD + text)
    before, after = task.load_model(), task.load_model()
    ModelWriter(task.parameters, after).write(after, task.parameters.nominal)
    for field in ("body_mass", "dof_damping", "actuator_gainprm", "actuator_biasprm"):
        np.testing.assert_array_equal(getattr(after, field), getattr(before, field), err_msg=field)
    for field in ("light_diffuse", "cam_pos", "cam_quat"):
        a, b = getattr(after, field), getattr(before, field)
        np.testing.assert_allclose(a, b, atol=1e-7, err_msg=field)


def test_a_pattern_may_choose_objects_that_a_factor_leaves_alone(declare):
    """Not so an object that is named; see the errors below."""
    (damping,) = declare("name = 'd'\nkind = 'damping'\nobjects = 's*'\n")
    assert (damping.objects, damping.nominal) == (("shoulder", "sled"), 1.0)


def test_a_servos_gain_takes_along_what_holds_against_it(declare):
    """So that a stiffer servo still goes to the same place."""
    space = declare("name = 'g'\nkind = 'gain'\nobjects = ['shoulder', 'elbow', 'sled']\n")
    model = mujoco.MjModel.from_xml_string(SCENE)
    before = model.actuator_biasprm.copy()
    writer = ModelWriter(space, model)
    for _ in range(2):
        writer.write(model, np.array([3.0]))
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], [60, 9, 3])
    np.testing.assert_allclose(model.actuator_biasprm[0, :3], [0, -60, -1])
    np.testing.assert_allclose(model.actuator_biasprm[1, :3], [0, 0, -9])
    np.testing.assert_array_equal(model.actuator_biasprm[2], before[2])
    batch = Batch(mujoco.MjModel.from_xml_string(SCENE), 2, 1)
    writer.write_batch(batch, np.array([[3.0], [0.5]]))
    np.testing.assert_allclose(batch.expand("actuator_biasprm")[:, 0, 1], [-60, -10])


@pytest.mark.parametrize("timestep_s", [0.001, 0.002, 0.004, 0.005])
@pytest.mark.parametrize("hz", [15, 30, 60, 120])
def test_delays_are_remembered_at_any_rate(folder, load, timestep_s, hz):
    """Physics steps divide a policy step, so they may be longer than the model's own."""
    scene = SCENE.replace('timestep="0.005"', f'timestep="{timestep_s}"')
    (folder / "scene.xml").write_text(scene)
    text = '[[parameters]]\nname = "late"\nkind = "delay"\nobjects = "sled"\nhigh = 0.1\n'
    task = load(f'model = "scene.xml"\ncontrol_timestep_s = {1 / hz}\n{text}')
    model = task.load_model()
    assert model.actuator_history[2, 0] * task.control_timestep_s / model.opt.timestep >= 1


def test_a_delay_is_remembered(load):
    text = '[[parameters]]\nname = "late"\nkind = "delay"\nobjects = "sled"\nhigh = 0.1\n'
    task = load(HEAD + text)
    simulator = task.simulator(image_size=16, step_s=1 / 30)
    num_samples = simulator.model.actuator_history[2, 0]
    assert num_samples * simulator.model.opt.timestep >= 0.1 * (1 - 1e-6)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("kind = 'mass'\nobjects = 'bob'\n", 3, r"\[\[parameters\]\] has no name"),
        ("name = 'a b'\nkind = 'mass'\nobjects = 'bob'\n", 4, "name must be letters.*'a b'"),
        ("name = 'p'\nobjects = 'bob'\n", 3, "p has neither kind nor field"),
        ("name = 'p'\nkinds = 'mass'\n", 5, "no key 'kinds' in .*; did you mean 'kind'?"),
        ("names = 'p'\nkind = 'mass'\n", 4, "has no name: expected a text; is 'names' meant"),
        ("name = 'p'\nkind = 'mas'\nobjects = 'bob'\n", 5, "no kind 'mas'.*did you mean 'mass'?"),
        ("name = 'p'\nkind = 'mass'\n", 3, r"\[\[parameters\]\] has no objects"),
        ("name = 'p'\nkind = 'mass'\nobject = 'bob'\n", 6, "no key 'object'.*mean 'objects'?"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bobb'\n", 6, "no body 'bobb'.*mean 'bob'?"),
        ("name = 'p'\nkind = 'mass'\nobjects = 3\n", 6, "objects must be a name or a list"),
        ("name = 'p'\nkind = 'mass'\nobjects = ['bob', 'bob']\n", 6, "'bob' is named twice"),
        (
            "name = 'p'\nkind = 'mass'\nfield = 'body_mass'\nobjects = 'bob'\n",
            6,
            "both kind and field",
        ),
        ("name = 'p'\nfield = 'body_mas'\nobjects = 'bob'\n", 5, "no field.*mean 'body_mass'?"),
        ("name = 'p'\nfield = 'xyzzy'\nobjects = 'bob'\n", 5, "no field 'xyzzy'.*body_mass"),
        ("name = 'p'\nfield = 'geom_type'\nobjects = 'bob'\n", 5, "holds no real numbers"),
        (
            "name = 'p'\nfield = 'pair_margin'\nobjects = 'bob'\n",
            6,
            "pair_margin cannot be written",
        ),
        ("name = 'p'\nfield = 'geom_rbound'\nobjects = 'bob'\n", 5, "MuJoCo derives geom_rbound"),
        (
            "name = 'p'\nfield = 'dof_M0'\nobjects = 'elbow'\n",
            5,
            "derives dof_M0 .*as geom_size, b",
        ),
        ("name = 'p'\nfield = 'cam_intrinsic'\nobjects = 'front'\n", 5, "own: tune its cam_fovy"),
        (
            "name = 'p'\nfield = 'jnt_axis'\nobjects = 'elbow'\n",
            6,
            "tuned by components 0 to 2, go",
        ),
        ("name = 'p'\nfield = 'body_mass'\n", 3, "body_mass needs the names of its objects"),
        ("name = 'p'\nfield = 'opt.wind'\nobjects = 'bob'\n", 6, "opt.wind has no objects"),
        ("name = 'p'\nfield = 'geom_friction'\nobjects = 'bob'\n", 3, "3 numbers: say which by"),
        ("name = 'p'\nkind = 'size'\nobjects = 'sled'\n", 3, "geom_size has 3 numbers.*0 to 2"),
        (
            "name = 'p'\nkind = 'size'\nobjects = 'sled'\ncomponent = 3\n",
            7,
            "components 0 to 2, got component = 3",
        ),
        (
            "name = 'p'\nkind = 'size'\nobjects = 'sled'\ncomponent = -1\n",
            7,
            "component must be a whole number of at least 0, got -1",
        ),
        (
            "name = 'p'\nfield = 'body_mass'\nobjects = 'bob'\ncomponent = 0\n",
            7,
            "body_mass has no components",
        ),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bob'\nlow = 'x'\n", 7, "low must be a finite numb"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bob'\nlow = inf\n", 7, "low must be a finite numb"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bob'\nlow = 3\nhigh = 2\n", 7, "low must be below"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bob'\nlow = 0.3\n", 7, "nominal 0.2 lies outside"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bob'\nlow = -2\n", 7, "mass cannot be negative"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'world'\n", 6, "world cannot move, so its mass"),
        ("name = 'p'\nkind = 'mass'\nobjects = 'bob'\nscale = 'lg'\n", 7, "no scale 'lg'.*'log'"),
        (
            "name = 'p'\nkind = 'mass'\nobjects = 'bob'\nscale = 'log'\nlow = 0\n",
            8,
            "log scale needs low > 0",
        ),
        (
            "name = 'p'\nkind = 'stiffness'\nobjects = 'elbow'\n",
            3,
            "is 0 in the model, so there is no usual range: give nominal",
        ),
        (
            "name = 'p'\nkind = 'stiffness'\nobjects = ['elbow', 'sled']\n",
            3,
            "is 0 there, so a factor changes nothing: give the joints a stiffness in the model",
        ),
        (
            "name = 'p'\nkind = 'stiffness'\nobjects = ['elbow', 'sled']\nnominal = 1\n",
            6,
            "is 0 there, so a factor changes nothing",
        ),
        (
            "name = 'p'\nkind = 'damping'\nobjects = ['elbow', 'sled']\n",
            6,
            r"sled has 0 there \(dof_damping\), so a factor does not change it",
        ),
        (
            "name = 'p'\nkind = 'delay'\nobjects = 'sled'\n",
            3,
            "has no usual range around 0: give high",
        ),
        ("name = 'p'\nkind = 'light'\nobjects = 'red'\n", 3, r"not one number .*: say nominal"),
        ("name = 'p'\nkind = 'colour'\nobjects = ['bob', 'block']\n", 3, "say nominal"),
        ("name = 'p'\nkind = 'colour'\nobjects = 'bob'\nnominal = 0.3\n", 7, "3 finite numbers"),
        (
            "name = 'p'\nkind = 'colour'\nobjects = 'bob'\nnominal = [0, 0, 2]\n",
            3,
            r"nominal 2 lies outside \[0.0, 1.0\]",
        ),
        ("name = 'p'\nkind = 'colour'\nobjects = 'bob'\nlow = 0\n", 7, "no key 'low'"),
        ("name = 'p'\nfield = 'cam_quat'\nobjects = 'front'\n", 3, "needs a component, the axis"),
        ("name = 'p'\nkind = 'camera_pose'\nobjects = 'frnt'\n", 6, "no camera 'frnt'"),
        ("name = 'p'\nkind = 'camera_pose'\nwithin_m = 0\n", 6, "number above 0, got 0"),
        (
            "name = 'p'\nkind = 'field_of_view'\nhigh = 300\n",
            3,
            "between 0 and 180°, got .* to 300",
        ),
        (
            f"name = 'p'\nkind = 'damping'\nobjects = 'elbow'\n{MASS}{MASS}",
            11,
            "'m' is declared twice",
        ),
        (
            f"name = 'p'\nkind = 'mass'\nobjects = ['upper', 'bob']\n{MASS}",
            7,
            "p and m write the same body_mass",
        ),
    ],
)
def test_what_is_wrong_with_a_parameter(refuses, text, line, message):
    refuses(f"{HEAD}[[parameters]]\n{text}", line, message)


# --- what comes of it -----------------------------------------------------------------------

PERCENT = """[actions]
mapping = "scaled"
actuators = "elbow"
range = [-100, 100]
"""


def record(folder: Path, num_actions: int, steps: int = 24) -> Path:
    """A dataset of noise, with actions in percent."""
    rng = np.random.default_rng(0)
    trajectories = [
        Trajectory(
            rng.integers(256, size=(steps + 1, 16, 16, 3)).astype(np.uint8),
            rng.uniform(-100, 100, (steps, num_actions)).astype(np.float32),
            0.05,
        )
        for _ in range(2)
    ]
    names = [f"a{i}" for i in range(num_actions)]
    write_dataset(folder, trajectories, action_names=names, robot_type="arm", task="swing")
    return folder


def test_a_pseudo_real_world_takes_its_actions(load):
    task = replace(load(HEAD + PERCENT + MASS), episode_steps=30)
    real, start, truth = choose_real(RealConfig(), task, 16)
    assert truth is not None
    (trajectory,) = real.collect(1)
    assert trajectory.actions.shape == (30, 1)
    assert 50 < np.abs(trajectory.actions).max() <= 100
    assert start.shape == (1,)


def test_recordings_need_as_many_actions(load, tmp_path):
    task = load(HEAD + PERCENT + MASS)
    real, start, _ = choose_real(RealConfig(real=str(record(tmp_path / "one", 1))), task, 16)
    assert real.collect(1)[0].actions.shape[1] == 1
    np.testing.assert_array_equal(start, task.parameters.nominal)
    three = str(record(tmp_path / "three", 3))
    with pytest.raises(InputError, match="the task takes 1 actions, the recording has 3"):
        choose_real(RealConfig(real=three), task, 16)


def test_actions_in_other_units_are_warned_of(load):
    task = load(HEAD + PERCENT + MASS)
    facts = {"control_hz": 20, "cameras": []}
    actions = np.linspace(-1, 1, 40, dtype=np.float32)[:, None]
    assert recording_warnings(task, facts, [100 * actions], 1) == []
    (said,) = recording_warnings(task, facts, [5000 * actions], 1)
    assert "actions of elbow go from -5000 to 5000, beyond the model's range of -100 to 100" in said


def test_actions_in_degrees_are_called_so(load):
    task = load(HEAD + "[actions]\nactuators = ['shoulder', 'elbow']\n" + MASS)
    low, high = task.load_actions().range[0]
    actions = np.array([[0.9 * low, 0], [0.9 * high, 0]] * 20, np.float32)
    facts = {"control_hz": 1 / task.step_s, "cameras": []}
    assert not [said for said in recording_warnings(task, facts, [actions], 1) if "degrees" in said]
    said, *_ = recording_warnings(task, facts, [np.rad2deg(actions)], 1)
    assert "such as degrees? Then" in said
    assert "gain = 0.0174533" in said


def test_actions_in_other_units_share_a_line(load):
    task = load(HEAD + "[actions]\nactuators = ['shoulder', 'elbow']\n" + MASS)
    actions = 5000 * np.linspace(-1, 1, 40, dtype=np.float32)[:, None].repeat(2, 1)
    (said,) = recording_warnings(task, {"control_hz": 1 / task.step_s, "cameras": []}, [actions], 1)
    assert said.startswith("actions of shoulder go from -5000 to 5000, beyond the model's range")
    assert said.endswith("are they in other units? (likewise elbow)")


def test_actions_in_another_order_are_noticed_whatever_recorders_add_to_names(load):
    task = load(HEAD + "[actions]\nactuators = ['shoulder', 'elbow']\n" + MASS)
    names = task.load_actions().names
    facts = {"control_hz": 1 / task.step_s, "cameras": [], "action_names": None}
    actions = np.random.default_rng(0).uniform(-0.1, 0.1, (40, 2)).astype(np.float32)
    as_it_is, swapped = ([f"{name}.pos" for name in order] for order in (names, names[::-1]))
    assert recording_warnings(task, facts | {"action_names": as_it_is}, [actions], 1) == []
    (said,) = recording_warnings(task, facts | {"action_names": swapped}, [actions], 1)
    assert f"say --actions {','.join(as_it_is)}" in said


@pytest.mark.slow
def test_check_takes_a_tuning_file_and_recordings(load, folder):
    load(HEAD + PERCENT + MASS)
    dataset = record(folder / "recorded", 1)
    result = check(CheckConfig(task=str(folder / "tune.toml"), real=dataset))
    # The film is noise, and the arm is welded to a target that stands still.
    stuck, small = result["warnings"]
    assert stuck.startswith("things move in the film, and nothing moves in the simulator")
    assert small.endswith("film it from nearer by")
    assert result["parameters"]["m"]["motion_largest_px"] > 0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("control_timestep_s = 0.05", "control_timestep_s = 50", "tune.toml:.*is it in seconds"),
        (
            'kind = "mass"',
            'kind = "armature"',
            "is 0 in the model, so there is no usual range: give nominal",
        ),
    ],
)
def test_numbers_that_cannot_be_meant(old, new, said, tmp_path):
    for name in ("scene.xml", "tune.toml", "policy.py"):
        (tmp_path / name).write_text((EXAMPLE.parent / name).read_text())
    text = (tmp_path / "tune.toml").read_text()
    assert old in text
    text = text.replace(old, new).replace('objects = "bob"', 'objects = "hinge"')
    (tmp_path / "tune.toml").write_text(text)
    with pytest.raises(InputError, match=said):
        load_task(str(tmp_path / "tune.toml"))


def test_all_files_of_a_task_are_known(tmp_path):
    """What the model includes and its meshes, a URDF's packages, code and what that imports."""
    texts = {
        "robots/arm/tune.toml": """# don't be put off by an apostrophe
            model = "../models/arm.xml"
            camera = { calibration = 'lens.yml' }
            environment = "env.py:make" """,
        "robots/arm/lens.yml": "",
        "robots/arm/env.py": "import helpers\nMODEL = 'deep/ball.urdf'",
        "robots/arm/helpers.py": "from more import *",
        "robots/arm/more/__init__.py": "",
        "robots/arm/unused.py": "",
        "robots/models/arm.xml": """<compiler meshdir="meshes"/><include file="part/hand.xml"/>""",
        "robots/models/part/hand.xml": """<mesh file="hand.stl"/>""",
        "robots/models/meshes/hand.stl": "",
        "robots/models/meshes/unused.stl": "",
        "robots/arm/deep/ball.urdf": """<mesh filename="package://ball/meshes/ball.stl"/>""",
        "robots/ball/meshes/ball.stl": "",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    found = {str(p.relative_to(tmp_path)) for p in named_files(tmp_path / "robots/arm/tune.toml")}
    assert found == {name for name in texts if "unused" not in name}


def test_meshes_whose_folder_an_included_file_names_are_known(tmp_path):
    """MuJoCo sees a meshdir from the folder of the main model, whichever file says it."""
    texts = {
        "tune.toml": 'model = "scene.xml"',
        "scene.xml": '<include file="robot/parts/arm.xml"/>',
        "robot/parts/arm.xml": """<compiler meshdir="robot/assets"/><mesh file="x.obj"/>""",
        "robot/assets/x.obj": "",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    found = named_files(tmp_path / "tune.toml")
    assert [str(file.relative_to(tmp_path)) for file in found] == list(texts)


@pytest.mark.parametrize(
    ("folder", "named", "file"),
    [
        ("..", "a.stl", "a.stl"),
        ("../2", "a.stl", "2/a.stl"),
        ("2", "a.stl", "mjcf/2/a.stl"),
        (".", "o'neil.stl", "mjcf/o'neil.stl"),
        (".", "a&amp;b.stl", "mjcf/a&b.stl"),
        (".", "a&#38;b.stl", "mjcf/a&b.stl"),
    ],
)
def test_files_with_unusual_names_are_known(tmp_path, folder, named, file):
    """meshdir="..", a folder that is a number, an apostrophe, XML's own writing of a letter."""
    for path in (tmp_path / file, tmp_path / "mjcf/bob's.xml"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'<compiler meshdir="{folder}"/><mesh file="{named}" pos="0 1e-3 .5"/>')
    (tmp_path / "mjcf/tune.toml").write_text('model = "bob\'s.xml"')
    found = [str(f.relative_to(tmp_path)) for f in named_files(tmp_path / "mjcf/tune.toml")]
    assert found == ["mjcf/tune.toml", "mjcf/bob's.xml", file]


def test_a_task_that_was_edited_is_another_one(tmp_path):
    scene, tune = tmp_path / "scene.xml", tmp_path / "tune.toml"
    for file in (scene, tune, tmp_path / "policy.py"):
        file.write_text((EXAMPLE.parent / file.name).read_text())

    def content() -> str:
        return load_task(str(tune)).content_hash

    before = content()
    for file, old, new in (
        (scene, "<worldbody>", "<option gravity='0 0 -3'/><worldbody>"),
        (tune, "control_timestep_s = 0.05", "control_timestep_s = 0.1"),
        (tune, 'name = "bob_mass"', 'low = 0.11\nname = "bob_mass"'),
    ):
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new, 1))
        assert content() != before, new
        file.write_text("# a comment is no change\n" * (file == tune) + text)
        assert content() == before


# --- what ordinary models have --------------------------------------------------------------

FOUR_BAR = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <body name="crank" pos="-.3 0 .5"><joint name="left" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02" contype="0"/>
      <body name="bar" pos="0 0 .3"><joint name="middle" axis="0 1 0"/>
        <geom name="rod" type="capsule" fromto="0 0 0 .6 0 0" size=".02" contype="0"/></body></body>
    <body name="rocker" pos=".3 0 .5"><joint name="right" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 .3" size=".02" contype="0"/></body>
    <body name="free" pos="0 1 .5"><joint name="swing" axis="0 1 0"/>
      <geom type="sphere" size=".05" contype="0"/></body>
  </worldbody>
  <equality><connect body1="bar" body2="rocker" anchor=".6 0 0"/></equality>
</mujoco>
"""
OF_THE_BAR = "[[parameters]]\nname = 'mass'\nkind = 'mass'\nobjects = ['bar']\n"


def test_a_closed_chain_is_not_torn_apart_by_its_start(folder, load):
    (folder / "scene.xml").write_text(FOUR_BAR)
    head = "model = 'scene.xml'\ncontrol_timestep_s = 0.05\n"
    batch = starts(load(head + OF_THE_BAR))
    for joint in ("left", "middle", "right"):
        assert np.ptp(spans(batch, joint)) == 0
    np.testing.assert_allclose(spans(batch, "swing"), [[-np.pi, np.pi]], atol=0.1)


@pytest.mark.parametrize("count", ["4 4 1", "3 3 3"])
def test_a_cloth_or_soft_body_starts_in_its_own_shape(folder, load, count):
    flex = f"""<mujoco><worldbody><camera name="front"/><flexcomp name="it" type="grid" mass=".1"
      count="{count}" spacing=".1 .1 .1" dim="{3 if count == "3 3 3" else 2}" radius=".01"
      pos="0 0 1"><edge equality="true"/></flexcomp><body name="bob" pos="2 0 1">
      <joint name="hinge"/><geom size=".1"/></body></worldbody></mujoco>"""
    (folder / "scene.xml").write_text(flex)
    batch = starts(load(HEAD + MASS), 20)
    assert np.ptp(spans(batch, "hinge")) > 1
    others = np.delete(batch.qpos, batch.model.joint("hinge").qposadr, axis=1)
    np.testing.assert_array_equal(others, np.zeros_like(others))


def test_a_model_that_was_exported_can_be_tuned_again(folder, load):
    pose = "[camera]\nposition_m = [0, -2, 1]\nlook_at_m = [0, 0, 0]\n"
    head = "model = 'scene.xml'\ncontrol_timestep_s = 0.05\n"
    task = load(head + pose + MASS)
    (folder / "scene.xml").write_text(task.load_spec().to_xml())
    again = load(head + pose.replace("-2", "-3") + MASS)
    assert camera_of(again)[0][1] == pytest.approx(-3)


ONE = "\ncomponent = 1\nnominal = 0.5\nlow = 0.1\nhigh = 1"


@pytest.mark.parametrize(
    ("parameter", "line", "message"),
    [
        ("field = 'opt.timestep'", 6, "it cannot be tuned"),
        ("kind = 'size'\nobjects = ['cube']\ncomponent = 0", 7, "cube has the size of its mesh"),
        (
            "kind = 'gain'\nobjects = 'brake'",
            7,
            "brake has no gain: it is a <damper>, whose −kv is",
        ),
        ("kind = 'gain'\nobjects = 'coil'", 7, "<dcmotor>, whose torque constant is component 1"),
        ("kind = 'gain'\nobjects = 'biceps'", 7, "muscle, whose force is component 2, or 3"),
        ("kind = 'tendon_length'\nobjects = 'rope'", 7, "rope has no limit: give it a range"),
        (f"field = 'jnt_range'\nobjects = 'hinge'{ONE}", 7, "hinge has no limit: give it a range"),
        (
            f"field = 'jnt_actfrcrange'\nobjects = 'hinge'{ONE}",
            7,
            r'a range .*\(actuatorfrcrange="',
        ),
        (
            f"field = 'actuator_ctrlrange'\nobjects = 'biceps'{ONE}",
            7,
            r'in the model \(ctrlrange="',
        ),
        (
            f"field = 'actuator_forcerange'\nobjects = 'coil'{ONE}",
            7,
            r'in the model \(forcerange="',
        ),
        (f"field = 'actuator_actrange'\nobjects = 'coil'{ONE}", 7, r'in the model \(actrange="'),
        (f"kind = 'size'\nobjects = 'ball'{ONE}", 8, "ball is a sphere, whose size has compo.* 0,"),
        ("kind = 'size'\nobjects = 'ball'\nnominal = 0.1", 7, "component 0, got none: say which"),
        (
            f"kind = 'size'\nobjects = 'pin'{ONE}".replace("= 1", "= 2", 1),
            8,
            "pin is a capsule, whose size has components 0 and 1, got component = 2",
        ),
        (f"field = 'site_size'\nobjects = 'dot'{ONE}", 8, "dot is a sphere, whose size has com"),
        ("kind = 'camera_pose'\nobjects = 'aimed'", 7, "aimed turns by itself, towards a body"),
        ("field = 'cam_quat'\ncomponent = 1\nobjects = 'aimed'", 8, "aimed turns by itself"),
        (f"field = 'body_pos'\nobjects = 'loose'{ONE}", 7, "loose is free, so it lies where"),
        (f"field = 'body_pos'\nobjects = 'hand'{ONE}", 7, "hand is a mocap body, which a state"),
        (f"field = 'body_ipos'\nobjects = 'world'{ONE}", 7, "world is what everything else is pla"),
        (f"field = 'qpos0'\nobjects = 'socket'\n{ONE[15:]}", 7, "socket is neither a hinge"),
        (f"field = 'jnt_axis'\nobjects = 'socket'{ONE}", 7, "socket is neither a hinge nor a sl"),
        (f"field = 'jnt_pos'\nobjects = 'float'{ONE}", 7, "float is a free joint, which is alwa"),
        (f"field = 'geom_fluid'\nobjects = 'ball'{ONE}", 7, 'give it fluidshape="ellipsoid"'),
        ("field = 'tendon_width'\nobjects = 'rope'", 7, "rope is over joints alone"),
        ("field = 'actuator_cranklength'\nobjects = 'coil'", 7, "coil drives no slider-crank"),
        (
            f"field = 'eq_data'\nobjects = 'tie'{ONE}".replace("= 1", "= 5", 1),
            8,
            "tie is a joint equality, whose data has components 0 to 4, got component = 5",
        ),
        (
            "field = 'body_inertia'\ncomponent = 2\nobjects = 'bar'\nhigh = 0.6",
            4,
            "x: no body has the inertia 0.6 beside the other two: expected 0.1 to 0.5, from their",
        ),
        (
            "field = 'body_inertia'\ncomponent = 2\nobjects = 'bar'\nlow = 0.05",
            9,
            "x: no body has the inertia 0.05 beside",
        ),
    ],
)
def test_what_could_not_be_meant_is_refused(parameter, line, message, folder, refuses):
    (folder / "scene.xml").write_text("""
<mujoco>
  <asset><mesh name="tent" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset>
  <worldbody>
    <camera name="front" pos="0 -2 .5"
    />
    <camera name="aimed" mode="targetbody" target="bar"/>
    <site name="dot" size=".1"/>
    <geom name="ball" size=".1"/>
    <geom name="pin" type="capsule" size=".1 .1"/>
    <body name="bar"><joint name="hinge"/><geom name="cube" type="mesh" mesh="tent"/>
      <inertial pos="0 0 0" mass="1" diaginertia=".2 .3 .4"/></body>
    <body name="hand" mocap="true"/>
    <body name="loose"><freejoint name="float"/><geom size=".1"/></body>
    <body><joint name="socket" type="ball"/><geom size=".1"/></body>
  </worldbody>
  <equality><joint name="tie" joint1="hinge"/></equality>
  <tendon><fixed name="rope"><joint joint="hinge" coef="1"/></fixed></tendon>
  <actuator>
    <damper name="brake" joint="hinge" kv="1" ctrlrange="0 1"/>
    <dcmotor name="coil" joint="hinge" motorconst="1" resistance="2"/>
    <muscle name="biceps" joint="hinge" lengthrange="0 1"/>
  </actuator>
</mujoco>
""")
    head = "model = 'scene.xml'\ncamera = 'front'\ncontrol_timestep_s = 0.05\n"
    refuses(f"{head}[[parameters]]\nname = 'x'\n{parameter}\n", line, message)


@pytest.mark.parametrize(
    "beside",
    [
        "kind = 'mass'\nobjects = 'bar'",
        "field = 'body_inertia'\ncomponent = 0\nobjects = 'b*'",
    ],
)
def test_an_inertia_beside_others_that_are_searched_has_its_usual_range(beside, folder):
    (folder / "scene.xml").write_text("""<mujoco><worldbody><camera name="front" pos="0 -2 .5"/>
    <body name="bar"><joint/><geom size=".1"/>
      <inertial pos="0 0 0" mass="1" diaginertia=".2 .3 .4"/></body></worldbody></mujoco>""")
    head = "model = 'scene.xml'\ncamera = 'front'\ncontrol_timestep_s = 0.05\n"
    izz = "[[parameters]]\nname = 'izz'\nfield = 'body_inertia'\ncomponent = 2\nobjects = 'bar'\n"
    (folder / "tune.toml").write_text(head + izz)
    alone = load_task(str(folder / "tune.toml")).parameters
    assert alone.high == pytest.approx(0.5, rel=1e-4)  # .2 + .3
    assert alone.low == pytest.approx(0.1, rel=1e-4)
    (folder / "tune.toml").write_text(f"{head}{izz}[[parameters]]\nname = 'x'\n{beside}\n")
    beside_it = load_task(str(folder / "tune.toml")).parameters
    assert beside_it.high[0] > 0.5
    assert beside_it.low[0] < 0.1


DEVICE = """<mujoco><worldbody><camera name="front" pos="0 -2 .5" resolution="640 480"
  sensorsize=".008 .006" focal="{}"/><body name="bar"><joint/><geom name="cube" type="box"
  size=".1 .1 .1"/></body></worldbody></mujoco>"""
FROM_FRONT = "model = 'scene.xml'\ncontrol_timestep_s = 0.05\n[camera]\ncamera = 'front'\n"
REGION = "region = { left = 0, top = 0, right = 640, bottom = 480, width = 640, height = 480 }\n"
VIEW = "[[parameters]]\nname = 'x'\nkind = 'field_of_view'\n"
BAR = """<mujoco><default>{}</default><worldbody>{}<body name="bar"><joint/><geom size=".1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("more", ["", REGION])
def test_a_camera_with_a_sensor_has_the_field_of_view_that_follows(more, folder, load):
    (folder / "scene.xml").write_text(DEVICE.format(".006 .006"))
    task, degrees = load(FROM_FRONT + more + VIEW), np.degrees(2 * np.arctan(0.5))
    model = task.load_model()
    assert model.cam_fovy[0] == pytest.approx(degrees, rel=0.01)
    assert not model.cam_sensorsize.any()
    assert task.parameters["x"].nominal == pytest.approx(degrees, rel=0.01)


def test_a_camera_that_no_field_of_view_describes_is_refused(folder, load):
    (folder / "scene.xml").write_text(DEVICE.format(".006 .009"))
    with pytest.raises(InputError, match="pixels that are not square"):
        load(FROM_FRONT + VIEW)


def test_an_orthographic_camera_is_refused(folder, load):
    text = DEVICE.format(".006 .006").replace("<camera ", '<camera projection="orthographic" ', 1)
    (folder / "scene.xml").write_text(text)
    with pytest.raises(InputError, match="orthographic, and a real camera has a perspective"):
        load(FROM_FRONT + VIEW)


@pytest.mark.parametrize(
    "default",
    [
        'sensorsize=".004 .003" focal=".003 .003" principal=".001 0" resolution="640 480"',
        'sensorsize=".004 .003" focalpixel="10 10" principalpixel="3 3" resolution="640 480"',
        'mode="trackcom"',
        'projection="orthographic"',
        'euler="0 0 90"',
    ],
)
def test_a_posed_camera_has_nothing_of_the_models_default_one(default, folder, load):
    pose = "position_m = [0, -2, 1]\nlook_at_m = [0, 0, 1]\nfield_of_view_deg = 42\n"
    models = []
    for defaults in (f"<camera {default}/>", ""):
        (folder / "scene.xml").write_text(BAR.format(defaults, ""))
        models.append(load(f"{HEAD}[camera]\n{pose}{VIEW}").load_model())
    for field in ("fovy", "quat", "mode", "projection", "sensorsize", "intrinsic"):
        here, plain = (getattr(model, f"cam_{field}") for model in models)
        np.testing.assert_array_equal(here, plain)


def test_a_camera_that_is_turned_to_a_region_stays_fixed(folder, load):
    fixed = '<camera name="front" mode="fixed" pos="0 -2 0" quat="1 1 0 0"/>'
    (folder / "scene.xml").write_text(BAR.format('<camera mode="trackcom"/>', fixed))
    model = load(FROM_FRONT + REGION + VIEW).load_model()
    assert model.cam_mode[0] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED


# --- [policy] -------------------------------------------------------------------------------

POLICY = MASS + "[policy]\n"


def test_a_reward_is_of_many_worlds_at_once(load, folder):
    (folder / "policy.py").write_text(
        "import numpy as np\n"
        "def height(data):\n"
        "    return data.xpos[:, data.model.body('bob').id, 2] + 0 * data.qpos[:, 0]\n"
        "def is_low(data):\n"
        "    return data.qpos[:, 1] < 0\n"
    )
    task = load(
        f'{HEAD}{POLICY}reward = "policy.py:height"\nsuccess = "policy.py:is_low"\nsteps = 7\n'
        "success_steps = 150\n"
        'free_joints = "sled"\nsymmetric_hinges = { elbow = 2 }\n'
    )
    assert (task.policy_steps, task.free_joints, task.goal_steps) == (7, ("sled",), 150)
    assert task.symmetric_hinges == {"elbow": 2}
    batch = Batch(task.load_model(), 4, 1)
    batch.qpos[:, 1] = angles = np.array([-1.0, -0.5, 0.0, 0.7])
    batch.forward()
    np.testing.assert_allclose(task.reward(batch), 0.5 - 0.4 * np.sin(angles), atol=1e-6)
    np.testing.assert_array_equal(task.success(batch) > 0, [True, True, False, False])
    assert list(task.goals) == ["success"]


def test_a_change_of_the_reward_is_noticed_and_not_by_who_tunes(load, folder):
    text = f'{HEAD}{POLICY}reward = "policy.py:f"\n'
    without, tasks = load(HEAD + MASS), []
    for factor in (1, 2):
        (folder / "policy.py").write_text(f"def f(data): return {factor} * data.qpos[:, 0]\n")
        tasks += [load(text), load(text + "steps = 7\n")]
    assert len({task.policy_hash for task in tasks}) == 4
    assert {task.content_hash for task in tasks} == {without.content_hash}
    assert without.policy_hash is None
    for factor in (1, 2):
        (folder / "gains_beside.py").write_text(f"FACTOR = {factor}\n")
        (folder / "policy.py").write_text(
            "import gains_beside\ndef f(data): return gains_beside.FACTOR * data.qpos[:, 0]\n"
        )
        tasks += [load(text)]
    assert len({task.policy_hash for task in tasks}) == 6


@pytest.mark.parametrize(
    ("lines", "code", "message"),
    [
        ("steps = 3", "", r"\[policy\] has no reward: expected a text"),
        ('reward = "f"', "", "expected FILE.py:NAME, a function in a file beside it, got f"),
        ('reward = "gone.py:f"', "", "there is no file .*gone.py"),
        ('reward = "policy.py:f"', "", "policy.py has no f to call"),
        ('reward = "policy.py:f"', "1 / 0", "policy.py cannot be run: ZeroDivisionError"),
        ('reward = "policy.py:f"', "raise SystemExit(3)", "policy.py cannot be run: SystemExit: 3"),
        ('reward = "policy.py:f"', "def f(): pass", "policy.py:f failed: TypeError"),
        (
            'reward = "policy.py:f"',
            "def f(data): return data.qpso",
            "failed: AttributeError: qpso is not an MjData array field",
        ),
        (
            'reward = "policy.py:f"',
            "def f(data): return data.qpos.sum()",
            r"must give a number for each world, here an array of shape \(\d+,\), got \(\)",
        ),
        (
            'reward = "policy.py:f"\nsuccess_steps = 9',
            "def f(data): return data.qpos[:, 0]",
            "success_steps needs success, whose time it limits",
        ),
        (
            'reward = "policy.py:f"\nsuccess = "policy.py:f"\nsuccess_steps = 201',
            "def f(data): return data.qpos[:, 0]",
            "success_steps must be at most an episode's 200 steps, got 201",
        ),
        (
            'reward = "policy.py:f"',
            "def f(data): return data.xpos[0, 1]",
            r"here an array of shape \(\d+,\), got \(3,\)",
        ),
        (
            'reward = "policy.py:f"',
            "def f(data):\n    q = data.qpos[:, 0]\n    q -= 1\n    return q",
            "failed: ValueError: output array is read-only",
        ),
        (
            'reward = "policy.py:f"',
            "def f(data): return data.qpos[:, 0] + float('inf')",
            "policy.py:f gives no finite number where the model starts",
        ),
        (
            'reward = "policy.py:f"\nsuccess = "policy.py:f"',
            "def f(data): return 0.5 + data.qpos[:, 0]",
            "policy.py:f must give true or false for each world, got 0.5",
        ),
        (
            'reward = "policy.py:f"\nfree_joints = "elbw"',
            "def f(data): return data.qpos[:, 0]",
            "no joint 'elbw' in the model; did you mean 'elbow'",
        ),
        (
            'reward = "policy.py:f"\nsymmetric_hinges = { elbow = 1 }',
            "def f(data): return data.qpos[:, 0]",
            "elbow must be a whole number of at least 2, got 1",
        ),
    ],
)
def test_what_is_wrong_with_a_policy(load, folder, lines, code, message):
    (folder / "policy.py").write_text(code)
    with pytest.raises(InputError, match=r"^\S+tune\.toml:\d+: .*" + message):
        load(f"{HEAD}{POLICY}{lines}\n")


def test_where_nothing_moves_no_motion_can_be_tuned(load, folder):
    """Nor is that found out after a minute of training."""
    resting = """<mujoco><option gravity="0 0 0"/><worldbody><light pos="0 0 2"/>
    <camera name="front" pos="0 -1 0" xyaxes="1 0 0 0 0 1"/>
    <body name="bob"><joint name="hinge" axis="0 1 0"/><geom size="0.1" mass="1"/></body>
    </worldbody><keyframe><key name="home"/></keyframe></mujoco>"""
    (folder / "scene.xml").write_text(resting)
    start = '[initial_state]\nkind = "keyframe"\nkeyframe = "home"\n'
    task = load(HEAD + start + MASS)
    context = context_of(task.simulator(image_size=32), task.parameters.nominal)
    with pytest.raises(InputError, match="m shows in motion only, and nothing moves"):
        PosteriorSearch(context)


def test_a_mark_in_front_of_the_text_is_no_mistake(folder):
    (folder / "tune.toml").write_text(HEAD + MASS, encoding="utf-8-sig")
    assert load_task(str(folder / "tune.toml")).parameters.names == ("m",)
