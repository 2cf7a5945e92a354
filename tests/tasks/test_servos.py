"""Parameters of servos, by hand on models of one joint: damping, lag, limits of the torque."""

import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.config import ExportConfig
from simtune.errors import InputError
from simtune.export import export
from simtune.parameters import ModelWriter
from simtune.run.files import write_json
from simtune.tasks import Task, load_task

# A bob of 1 kg at 0.5 m, whose weight pulls the arm down at angle 0: 4.905 N·m.
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <body name="arm">
      <joint name="elbow" axis="0 -1 0"/>
      <geom name="bob" size=".01" pos=".5 0 0" mass="1"/>
    </body>
    <body name="sled" pos="0 1 0">
      <joint name="sled" type="slide" axis="1 0 0" damping="2"/>
      <geom size=".1" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <position name="elbow" joint="elbow" kp="50" kv="8"/>
    <motor name="push" joint="sled"/>
    <general name="servo" joint="sled" gainprm="3" biastype="affine" biasprm="0 -3 -.5"
             forcerange="-2 2"/>
    <velocity name="speed" joint="sled" kv="1"/>
    <intvelocity name="integrates" joint="sled" kp="1" actrange="-1 1"/>
    <position name="follows" joint="sled" kp="1" timeconst=".2"/>
  </actuator>
  <keyframe><key name="up" qpos="1 0" ctrl="1 0 0 0 0 .7" act=".1 .2"/></keyframe>
</mujoco>
"""
HEAD = 'model = "scene.xml"\ncontrol_timestep_s = 0.02\n'


@pytest.fixture
def load(load):
    """Loads a file with some parameters."""

    def with_parameters(*parameters: str, **top: str) -> Task:
        lines = [f"{key} = {value}\n" for key, value in top.items()]
        tables = [f"\n[[parameters]]\n{text}\n" for text in parameters]
        return load("".join([HEAD, *lines, *tables]))

    return with_parameters


def parameter(name: str, kind: str, objects: str, **more: float) -> str:
    lines = [f"name = '{name}'", f"kind = '{kind}'", f"objects = '{objects}'"]
    return "\n".join([*lines, *(f"{key} = {value}" for key, value in more.items())])


def simulate(task: Task, values: list[float], controls: np.ndarray) -> np.ndarray:
    """(T + 1, S) full states under (T, nu) controls."""
    simulator, rng = task.simulator(image_size=16), np.random.default_rng(0)
    return simulator.roll_out(np.array([values]), controls[None], rng).states[0]


def elbow(states: np.ndarray) -> np.ndarray:
    return states[:, 1]


def constant(task: Task, num: int, **controls: float) -> np.ndarray:
    names = task.load_actions().names
    return np.tile([controls.get(name, 0.0) for name in names], (num, 1))


def test_a_servo_sags_by_the_weight_over_kp_whatever_its_damping(load):
    task = load(
        parameter("kv", "gain_damping", "elbow"), parameter("kp", "gain", "elbow", high=600)
    )
    assert task.parameters.nominal.tolist() == [8, 50]
    for kp, kv in ((50, 4.0), (500, 40.0)):
        angle = elbow(simulate(task, [kv, kp], constant(task, 400)))[-1]
        assert -angle * kp == pytest.approx(9.81 * 0.5 * np.cos(angle), rel=1e-3)


def test_a_gain_does_not_move_the_target_of_a_servo_of_another_scale(load, folder):
    """As a gripper's, whose control goes from 0 to 255."""
    plain = 'gainprm="3" biastype="affine" biasprm="0 -3 -.5"'
    scaled = 'gainprm=".5" biastype="affine" biasprm="10 -100 -10"'
    (folder / "scene.xml").write_text(SCENE.replace(plain, scaled))
    task = load(parameter("kp", "gain", "servo"))
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([1.5]))
    servo = model.actuator("servo")
    assert (servo.gainprm[0], *servo.biasprm[:3]) == (1.5, 30, -300, -10)


@pytest.mark.parametrize("component", [0, 2, 7])
def test_the_passive_force_of_a_muscle_is_tuned_with_the_active_one(load, folder, component):
    muscle = '<muscle name="push" joint="sled" force="30" lengthrange="0 1"/>'
    motor = '<motor name="push" joint="sled"/>'
    xml = re.sub("<key .*/>", "", SCENE).replace(motor, muscle)
    (folder / "scene.xml").write_text(xml)
    own = "field = 'actuator_gainprm'\nobjects = 'push'\nlow = 0.1\nhigh = 90"
    task = load(f"name = 'force'\n{own}\ncomponent = {component}")
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([50.0]))
    push = model.actuator("push")
    assert push.gainprm[component] == 50
    np.testing.assert_array_equal(push.biasprm, push.gainprm)


def test_damping_is_the_force_against_the_velocity(load):
    task = load(parameter("kv", "gain_damping", "elbow"))
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([3.0]))
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    mujoco.mj_forward(model, data)
    assert data.actuator("elbow").force[0] == pytest.approx(-6)
    assert model.actuator("elbow").biasprm[1] == -50


def test_gain_and_damping_of_one_servo_are_written_one_by_one(load):
    task = load(parameter("kv", "gain_damping", "servo"), parameter("kp", "gain", "servo"))
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([0.2, 9.0]))
    servo = model.actuator("servo")
    assert (servo.gainprm[0], *servo.biasprm[:3]) == (9, 0, -9, -0.2)
    assert task.parameters["kv"].unit == "N·s/m"


def test_a_force_ends_at_its_limit(load):
    task = load(
        parameter("most", "torque_limit", "elbow", nominal=3.0),
        parameter("push", "torque_limit", "servo"),
    )
    assert task.parameters.nominal.tolist() == [3, 2]
    assert task.parameters["push"].unit == "N"
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([6.0, 1.5]))
    data = mujoco.MjData(model)
    for target, force in ((3.0, 6.0), (-3.0, -6.0), (0.1, 5.0)):
        data.ctrl[0] = target
        mujoco.mj_forward(model, data)
        assert data.actuator("elbow").force[0] == pytest.approx(force)
    # 4.905 N·m of weight: 6 N·m lift the bob, 4 do not.
    lifted, sunk = (
        elbow(simulate(task, [limit, 2], constant(task, 50, elbow=0.5)))[-1] for limit in (6, 4)
    )
    assert lifted > 0.3
    assert sunk < -0.5


def test_a_lag_follows_a_step_as_an_exponential_does(load):
    task = load(parameter("lag", "lag", "push"))
    lag = task.parameters["lag"]
    assert (lag.nominal, lag.low, lag.high, lag.scale, lag.unit) == (0.05, 0.005, 0.5, "log", "s")
    model = task.load_model()
    assert model.actuator("push").dyntype[0] == mujoco.mjtDyn.mjDYN_FILTEREXACT
    for tau in (0.005, 0.05, 0.5):
        states = simulate(task, [tau], constant(task, 20, push=1.0))
        times = 0.02 * np.arange(21)
        np.testing.assert_allclose(states[:, 5], 1 - np.exp(-times / tau), atol=1e-9)


def test_no_lag_at_all_is_stable(load):
    task = load(parameter("lag", "lag", "elbow", low=0, high=0.5))
    assert task.parameters["lag"].scale == "linear"
    without = load(parameter("kv", "gain_damping", "elbow"))
    controls = constant(task, 50)
    controls[10:, 0] = 0.5
    late, early = simulate(task, [0.0], controls), simulate(without, [8.0], controls)
    # A filter of no time constant still takes the control of the step before.
    np.testing.assert_allclose(elbow(late), elbow(early), atol=0.03)
    np.testing.assert_allclose(elbow(late)[-1], elbow(early)[-1], atol=1e-4)


def as_late_as(task: Task, played: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """(T + 1, S) what servos of no lag and no delay do from the same start under (T, nu) controls.

    `task`: with the damping alone.
    """
    simulator = task.simulator(image_size=16)
    rng, worlds = np.random.default_rng(0), task.parameters.nominal[None]
    starts = simulator.roll_out(worlds, controls[None], rng).states[:, 0]
    starts[:, :5] = played[0, :5]
    return simulator.roll_out(worlds, controls[None], rng, starts=starts).states[0]


@pytest.mark.parametrize("values", [[0.5, 0.0], [0.05, 0.5], [0.5, 0.5]])
def test_servos_have_held_their_first_control_before_an_episode(load, values):
    lag, late = parameter("lag", "lag", "elbow"), parameter("late", "delay", "elbow", high=0.5)
    task = load(lag, late)
    controls = constant(task, 60, elbow=0.8)
    played = simulate(task, values, controls)
    expected = as_late_as(load(parameter("kv", "gain_damping", "elbow")), played, controls)
    np.testing.assert_allclose(elbow(played), elbow(expected), atol=1e-9)


def test_a_delay_of_half_a_second_comes_half_a_second_late(load):
    task = load(parameter("late", "delay", "elbow", high=0.5))
    controls = constant(task, 100)
    controls[10:, 0] = 0.7
    played = simulate(task, [0.5], controls)
    late = np.vstack([np.repeat(controls[:1], 25, 0), controls[:-25]])
    expected = as_late_as(load(parameter("kv", "gain_damping", "elbow")), played, late)
    np.testing.assert_allclose(elbow(played), elbow(expected), atol=1e-6)


def test_a_factor_on_limits_acts_on_the_joints_limits_too(load, tmp_path):
    xml = SCENE.replace('name="elbow" axis', 'name="elbow" actuatorfrcrange="-2 2" axis')
    xml = xml.replace('<position name="elbow"', '<position name="elbow" forcerange="-5 5"')
    (tmp_path / "scene.xml").write_text(
        xml.replace('type="slide"', 'type="slide" actuatorfrcrange="-6 6"')
    )
    task = load("name = 'most'\nkind = 'torque_limit'\nobjects = ['elbow', 'servo']")
    mean = np.array([3.0])
    out = export(ExportConfig(run_folder=a_run(tmp_path, task, mean), out=tmp_path / "out"))
    tuned, copy = task.load_model(), tmp_path / "copy.xml"
    ModelWriter(task.parameters, tuned).write(tuned, mean)
    script = [sys.executable, str(out / "apply.py"), str(tmp_path / "scene.xml"), str(copy)]
    subprocess.run(script, check=True)
    exported = [mujoco.MjModel.from_xml_path(str(path)) for path in (out / "model.xml", copy)]
    for model in (tuned, *exported):
        data = mujoco.MjData(model)
        data.actuator("elbow").ctrl = data.actuator("servo").ctrl = 9
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator, [3 * 2, 3 * 2], rtol=1e-6)


def test_a_factor_needs_no_limits_beside_those_of_joints(load, tmp_path):
    of_joint, of_slide = ('name="elbow" axis', "-2 2"), ('type="slide"', "-6 6")
    xml = re.sub(r"<(motor|velocity|intvelocity).*|<position name=.follows.*|<key .*/>", "", SCENE)
    xml = xml.replace('forcerange="-2 2"', "")
    for place, limits in (of_joint, of_slide):
        xml = xml.replace(place, f'actuatorfrcrange="{limits}" {place}')
    (tmp_path / "scene.xml").write_text(xml)
    task = load("name = 'most'\nkind = 'torque_limit'\nobjects = ['elbow', 'servo']")
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([1.5]))
    np.testing.assert_allclose(model.actuator_forcerange, [[-3, 3], [-9, 9]])


def test_a_limit_of_several_actuators_together_is_none_of_one(load, tmp_path):
    (tmp_path / "scene.xml").write_text(
        SCENE.replace('type="slide"', 'type="slide" actuatorfrcrange="-6 6"')
    )
    with pytest.raises(InputError, match=r"push is one of several .* limited .* jnt_actfrcrange"):
        load(parameter("most", "torque_limit", "push", nominal=2))
    model = load(parameter("most", "torque_limit", "servo")).load_model()
    assert model.jnt_actfrclimited[model.joint("sled").id]


def test_a_limit_of_a_tendon_is_that_of_its_actuator(load, tmp_path):
    cord = '<fixed name="cord" actuatorfrcrange="-4 4"><joint joint="elbow" coef="1"/></fixed>'
    xml = SCENE.replace("<actuator>", f"<tendon>{cord}</tendon><actuator>")
    (tmp_path / "scene.xml").write_text(
        xml.replace('<position name="elbow" joint="elbow"', '<position name="elbow" tendon="cord"')
    )
    task, mean = load(parameter("most", "torque_limit", "elbow")), np.array([9.0])
    assert task.parameters.nominal == [4]
    out = export(ExportConfig(run_folder=a_run(tmp_path, task, mean), out=tmp_path / "out"))
    copy = tmp_path / "copy.xml"
    script = [sys.executable, str(out / "apply.py"), str(tmp_path / "scene.xml"), str(copy)]
    subprocess.run(script, check=True)
    for path in (out / "model.xml", copy):
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        data.actuator("elbow").ctrl = 9
        mujoco.mj_forward(model, data)
        assert data.qfrc_actuator[0] == pytest.approx(9)


def test_an_actuator_that_is_a_filter_keeps_its_own_lag_and_keyframes_grow(load):
    own = load(parameter("lag", "lag", "follows"))
    assert own.parameters["lag"].nominal == 0.2
    assert own.load_model().key("up").act.tolist() == [0.1, 0.2]
    new = load("name = 'lag'\nkind = 'lag'\nobjects = ['elbow', 'follows']")
    assert not new.parameters["lag"].is_factor
    assert new.load_model().key("up").act.tolist() == [1, 0.1, 0.2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (parameter("p", "gain_damping", "push"), "push is no servo of positions"),
        (parameter("p", "gain_damping", "speed"), "speed is no servo of positions"),
        (
            parameter("p", "gain_damping", "follows"),
            "is 0 in the model, so there is no usual range: give nominal",
        ),
        (parameter("p", "gain_damping", "elbow", nominal=-1), "cannot be negative, got -1"),
        (parameter("p", "lag", "integrates"), "integrates has dynamics of its own"),
        (parameter("p", "lag", "push", low=-1), "cannot be negative, got low = -1"),
        (parameter("p", "lag", "push", low=0, scale="'log'"), "a log scale needs low > 0"),
        (parameter("p", "torque_limit", "push"), r"push has no limit .* say nominal"),
        (
            "name = 'p'\nkind = 'torque_limit'\nobjects = ['push', 'servo']\nnominal = 2",
            "push has no limit .*: give it a parameter of its own",
        ),
    ],
)
def test_what_actuators_have_not_is_refused_in_a_line(load, text, message):
    with pytest.raises(InputError, match=message) as caught:
        load(text)
    assert "tune.toml:" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "actuator", "message"),
    [
        ("lag", '<pid name="odd" joint="sled" kp="1" input="pos"/>', "pid requires dyntype"),
        (
            "delay",
            '<dcmotor name="odd" joint="sled" motorconst="1" resistance="1" input="none"/>',
            "history and delay require an input",
        ),
    ],
)
def test_what_mujoco_allows_no_actuator_is_refused_in_a_line(load, folder, kind, actuator, message):
    (folder / "scene.xml").write_text(SCENE.replace("<actuator>", f"<actuator>{actuator}"))
    more = {"high": 0.1} if kind == "delay" else {}
    with pytest.raises(InputError, match=f"tune.toml:4: MuJoCo allows no p there: .*{message}"):
        load(parameter("p", kind, "odd", **more))


def test_two_that_write_the_same_number_are_refused(load):
    raw = "name = 'raw'\nfield = 'actuator_biasprm'\ncomponent = 2\nobjects = 'elbow'\n"
    with pytest.raises(InputError, match="kv and raw write the same actuator_biasprm"):
        load(parameter("kv", "gain_damping", "elbow"), raw + "low = -9\nhigh = -1")


def test_a_model_that_was_not_prepared_is_refused(load):
    plain = mujoco.MjModel.from_xml_string(SCENE)
    for text, message in (
        (parameter("p", "lag", "push"), "p: the model has no filter of the control; Task.load"),
        (parameter("p", "torque_limit", "push", nominal=2), "p: the model has no limit of the"),
    ):
        with pytest.raises(InputError, match=message):
            ModelWriter(load(text).parameters, plain)


def test_an_offset_turns_the_body_but_neither_the_encoder_nor_what_drives_it(load):
    task = load(
        parameter("zero", "joint_offset", "elbow"), parameter("slid", "joint_offset", "sled")
    )
    zero, slid = task.parameters
    assert (zero.nominal, zero.low, zero.high, zero.scale, zero.unit) == (
        0,
        -0.1,
        0.1,
        "linear",
        "rad",
    )
    assert (slid.low, slid.high, slid.unit) == (-0.02, 0.02, "m")
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([0.08, -0.01]))
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[0] = [0.3, 0.1], 0.3
    mujoco.mj_forward(model, data)
    turned = 0.3 - 0.08
    np.testing.assert_allclose(
        data.geom("bob").xpos, [0.5 * np.cos(turned), 0, 0.5 * np.sin(turned)], atol=1e-12
    )
    np.testing.assert_allclose(data.body("sled").xpos, [0.11, 1, 0], atol=1e-12)
    assert data.actuator("elbow").force[0] == pytest.approx(0, abs=1e-9)


def test_worlds_of_different_offsets_start_and_look_as_their_own(load):
    task = load(
        parameter("zero", "joint_offset", "elbow"),
        initial_state="{kind = 'keyframe', keyframe = 'up'}",
    )
    simulator = task.simulator(image_size=32)
    worlds = np.array([[-0.1], [0.0], [0.1]])
    seen = simulator.roll_out(
        worlds,
        np.tile(constant(task, 2, elbow=1.0), (3, 1, 1)),
        np.random.default_rng(0),
        lambda batch: batch.bind("geom_xpos")[:, 0].copy(),
    )
    np.testing.assert_allclose(seen.states[:, 0, 1], 1)
    angles = np.arctan2(seen.observed[:, 0, 2], seen.observed[:, 0, 0])
    np.testing.assert_allclose(angles, [1.1, 1.0, 0.9], atol=1e-9)
    frames = simulator.render(seen.states[[1, 1, 1], 0], worlds)
    opengl = task.simulator(image_size=32, renderer="opengl")
    by_opengl = opengl.render(seen.states[[1, 1, 1], 0], worlds)
    for drawn in (frames, by_opengl):
        assert (drawn[0] != drawn[2]).any()


def test_an_offset_carries_a_spring_along(load, tmp_path):
    spring = 'axis="0 -1 0" stiffness="7" springref="10"'
    (tmp_path / "scene.xml").write_text(SCENE.replace('axis="0 -1 0"', spring))
    task = load(parameter("zero", "joint_offset", "elbow"))
    model = task.load_model()
    ModelWriter(task.parameters, model).write(model, np.array([0.08]))
    assert model.qpos_spring[0] == pytest.approx(np.deg2rad(10) + 0.08)


def test_weight_that_something_else_carries_does_not_pull(load):
    """A controller that feeds the weight forward, as many arms do: 6 % of it are left."""
    task = load(parameter("carried", "gravity_compensation", "arm"))
    carried = task.parameters["carried"]
    assert (carried.nominal, carried.low, carried.high, carried.scale) == (0.5, 0, 1.2, "linear")
    for share in (0.0, 0.94):
        angle = elbow(simulate(task, [share], constant(task, 400)))[-1]
        assert -angle * 50 == pytest.approx((1 - share) * 4.905 * np.cos(angle), rel=2e-3)
    both = load(parameter("carried", "gravity_compensation", "*").replace("'*'", "['arm', 'sled']"))
    assert both.parameters["carried"].unit == "1"  # of each its own weight: no factor


def test_what_is_exported_does_the_same_in_plain_mujoco(load, tmp_path):
    # As URDF's effort: below the limit that is found
    weak = SCENE.replace('name="elbow" axis', 'name="elbow" actuatorfrcrange="-2 2" axis')
    (tmp_path / "scene.xml").write_text(weak)
    task = load(
        parameter("kv", "gain_damping", "elbow"),
        parameter("kp", "gain", "elbow"),
        parameter("most", "torque_limit", "elbow", nominal=6.0),
        parameter("lag", "lag", "elbow"),
        parameter("push_lag", "lag", "push"),
        parameter("late", "delay", "servo", high=0.1),
        parameter("most_of_servo", "torque_limit", "servo"),
        parameter("zero", "joint_offset", "elbow"),
        parameter("carried", "gravity_compensation", "arm"),
    )
    mean = np.array([3.0, 70, 5.5, 0.12, 0.03, 0.07, 1.2, 0.06, 0.9])
    out = export(ExportConfig(run_folder=a_run(tmp_path, task, mean), out=tmp_path / "out"))
    tuned = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    simulator = task.simulator(image_size=16)
    controls = np.random.default_rng(1).uniform(-1, 1, (30, tuned.nu))
    played = simulator.roll_out(mean[None], controls[None], np.random.default_rng(0)).states[0]
    data = mujoco.MjData(tuned)
    mujoco.mj_setState(tuned, data, played[0], mujoco.mjtState.mjSTATE_INTEGRATION)
    for control, expected in zip(controls, played[1:], strict=True):
        data.ctrl[:] = control
        mujoco.mj_step(tuned, data, nstep=10)
        np.testing.assert_allclose(data.qpos, expected[1:3], atol=1e-5)
    copy = tmp_path / "copy.xml"
    script = [sys.executable, str(out / "apply.py"), str(tmp_path / "scene.xml"), str(copy)]
    subprocess.run(script, check=True)
    again = mujoco.MjModel.from_xml_path(str(copy))
    np.testing.assert_allclose(again.qpos0, tuned.qpos0, atol=1e-6)
    assert again.ngravcomp == tuned.ngravcomp == 1
    assert not again.jnt_actfrclimited.any()
    assert not tuned.jnt_actfrclimited.any()
    assert again.body_gravcomp[again.body("arm").id] == pytest.approx(0.9)
    for field in ("dyntype", "dynprm", "forcerange", "forcelimited", "biasprm", "gainprm", "delay"):
        ours, theirs = (getattr(model, f"actuator_{field}") for model in (tuned, again))
        np.testing.assert_allclose(theirs, ours, atol=1e-5, err_msg=field)


def a_run(path: Path, task: Task, mean: np.ndarray) -> Path:
    """The folder of a run that found (N,) `mean`."""
    name, folder = str(path / "tune.toml"), path / "run"
    found = {
        p.name: {"unit": p.unit, "nominal": p.nominal, "mean": value, "verdict": "weak"}
        | {"low": value, "high": value}
        for p, value in zip(task.parameters, mean.tolist(), strict=True)
    }
    folder.mkdir()
    result = {"task": name, "method": "autotune", "seed": 3, "warnings": []}
    write_json(folder / "result.json", result | {"parameters": found})
    config = {"task": name, "task_content": load_task(name).content_hash}
    write_json(folder / "config.json", {"config": config, "versions": {"mujoco": "3"}})
    return folder
