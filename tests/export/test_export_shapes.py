"""`export` of worlds whose shapes are tuned: masses and lengths stay as the run had them."""

import runpy
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_export import a_run, differences, the_tuned_world

from simtune.config import ExportConfig
from simtune.errors import InputError
from simtune.export import export
from simtune.export.mjcf import write_mjcf, write_spec
from simtune.export.round_trip import compare
from simtune.parameters import ModelWriter, ParameterSpace
from simtune.parameters.inferred import write_down_inferred

pytestmark = pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")

SCENE = """
<mujoco>
  <compiler inertiafromgeom="true" {compiler}/>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/> <light pos="0 0 3"/>
    <site name="hook" pos="0 0 1"/>
    <body name="arm" pos="0 0 .5"><joint name="shoulder" axis="0 1 0" damping=".1"/>
      <geom name="rod" type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
      <body name="hand" pos=".3 0 0"><joint name="wrist" axis="0 1 0" damping=".1"/>
        <geom name="palm" type="box" size=".1 .02 .02"/> <site name="tip" pos=".1 0 0"/>
      </body></body>
  </worldbody>
  <tendon><spatial name="spring" stiffness="20"><site site="hook"/><site site="tip"/></spatial>
  </tendon>
</mujoco>
"""
TUNING = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [
  {name = "width", kind = "size", objects = ["rod"], component = 0},
  {name = "mass", kind = "mass", objects = ["hand"]},
  {name = "tip", field = "site_pos", component = 0, objects = ["tip"], low = 0.02, high = 0.4},
]
"""


@pytest.fixture(params=["", 'settotalmass="3"'])
def scene(request, tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "scene.xml").write_text(SCENE.format(compiler=request.param))
    (folder / "scene.toml").write_text(TUNING)
    return folder / "scene.toml"


def after_a_second(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    return data.qpos


def exported_both_ways(
    xml: str, toml: str, folder: Path
) -> tuple[tuple[Path, Path], mujoco.MjModel]:
    """A run's model.xml, and what apply.py makes of the original; the world they should equal."""
    (folder / "scene.xml").write_text(xml)
    (folder / "scene.toml").write_text(toml)
    task = str(folder / "scene.toml")
    run, mean = a_run(folder / "run", task)
    out, copy = export(ExportConfig(run_folder=run, out=folder / "out")), folder / "copy.xml"
    subprocess.run([sys.executable, out / "apply.py", folder / "scene.xml", copy], check=True)
    return (out / "model.xml", copy), the_tuned_world(task, mean)


def test_nothing_is_inferred_anew_from_tuned_shapes(scene, tmp_path):
    run, mean = a_run(tmp_path / "run", str(scene))
    out = export(ExportConfig(run_folder=run, out=tmp_path / "out"))
    expected = the_tuned_world(str(scene), mean)
    nominal = mujoco.MjModel.from_xml_path(str(scene.parent / "scene.xml"))
    assert nominal.body_mass[1] == pytest.approx(expected.body_mass[1])  # a size is no mass
    copy = tmp_path / "copy.xml"
    subprocess.run([sys.executable, out / "apply.py", scene.parent / "scene.xml", copy], check=True)
    runpy.run_path(str(out / "apply.py"))["apply"](nominal)
    np.testing.assert_allclose(nominal.body_inertia, expected.body_inertia)
    for path in (out / "model.xml", copy):
        exported = mujoco.MjModel.from_xml_path(str(path))
        for field in ("body_mass", "body_inertia", "body_ipos", "tendon_lengthspring"):
            values, wanted = getattr(exported, field), getattr(expected, field)
            np.testing.assert_allclose(values, wanted, rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(after_a_second(exported), after_a_second(expected), atol=1e-3)


DERIVED = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <site name="hook" pos="0 0 1"/>
    <body name="arm" pos="0 0 .5">
      <joint name="shoulder" axis="0 1 0" springdamper=".5 1" range="-90 90"/>
      <geom name="rod" type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
      <site name="tip" pos=".3 0 0"/>
    </body>
  </worldbody>
  <tendon><spatial name="cord"><site site="hook"/><site site="tip"/></spatial></tendon>
  <actuator>
    <position name="servo" joint="shoulder" kp="20" dampratio="1" inheritrange="1"/>
    <intvelocity name="turns" joint="shoulder" kp="3" inheritrange=".5"/>
    <muscle name="muscle" tendon="cord"/>
  </actuator>
</mujoco>
"""
OF_DERIVED = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [
  {name = "mass", kind = "mass", objects = ["arm"]},
  {name = "tip", field = "site_pos", component = 0, objects = ["tip"], low = 0.02, high = 0.4},
  {name = "end", field = "jnt_range", component = 1, objects = ["shoulder"], low = 0.5, high = 2},
]
"""

# Values that MjSpec.copy_back omits, and directions, of which one component is tuned
OMITTED = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <light name="lamp" pos="0 0 3" dir="0 .6 -.8" intensity="2"/>
    <body name="arm" pos="0 0 .5">
      <joint name="shoulder" axis="0 1 0" actuatorfrcrange="-5 5"/>
      <geom name="rod" type="box" size=".1 .2 .3" fluidshape="ellipsoid"/>
    </body>
  </worldbody>
</mujoco>
"""
OF_OMITTED = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [
  {name = "most", field = "jnt_actfrcrange", component = 1, objects = ["shoulder"]},
  {name = "bright", field = "light_intensity", objects = ["lamp"]},
  {name = "soft", field = "light_softness", objects = ["lamp"]},
  {name = "drag", field = "geom_fluid", component = 1, objects = ["rod"]},
  {name = "aim", field = "light_dir", component = 0, objects = ["lamp"], low = -0.5, high = 0.9},
  {name = "axis", field = "jnt_axis", component = 0, objects = ["shoulder"], low = 0, high = 0.9},
  {name = "turn", field = "body_iquat", component = 0, objects = ["arm"], low = 0, high = 0.4},
]
"""

# The compiler's bounds, which tuned values are below
BOUNDED = """
<mujoco>
  <compiler boundmass="2" boundinertia=".2" balanceinertia="true"/>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <body name="arm" pos="0 0 .5">
      <joint name="shoulder" axis="0 1 0"/><geom name="rod" size=".1" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""
OF_BOUNDED = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [
  {name = "mass", field = "body_mass", objects = ["arm"], low = 0.1, high = 2.1},
]
"""


@pytest.mark.parametrize(
    ("xml", "toml"), [(DERIVED, OF_DERIVED), (OMITTED, OF_OMITTED), (BOUNDED, OF_BOUNDED)]
)
def test_nothing_is_inferred_anew_or_left_out(xml, toml, tmp_path):
    paths, expected = exported_both_ways(xml, toml, tmp_path)
    for path in paths:
        exported = mujoco.MjModel.from_xml_path(str(path))
        assert differences(exported, expected, rtol=1e-4) == [], path.name


# A keyframe without positions, a plate and a speck whose inertias MJCF's six digits would spoil
THIN = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <body name="arm" pos="0 0 .5"><joint name="shoulder" axis="0 1 0"/><geom name="rod" size=".1"/>
    </body>
    {plates}
    <body pos="2 0 1"><joint/><geom size=".0001" mass="1e-5"/></body>
  </worldbody>
  <actuator><motor name="turn" joint="shoulder"/></actuator>
  <keyframe><key name="home" ctrl=".3"/></keyframe>
</mujoco>
""".format(
    plates="\n".join(
        f'<body pos="1 0 1"><joint/><geom type="box" size=".2{i} .1{3 * i % 10} 5e-5" mass="1" '
        'euler="10 20 30"/></body>'
        for i in range(10)
    )
)
OF_THIN = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [{name = "zero", kind = "joint_offset", objects = ["shoulder"]}]
"""


def test_thin_bodies_and_keyframes_without_positions_are_kept(tmp_path):
    paths, expected = exported_both_ways(THIN, OF_THIN, tmp_path)
    for path in paths:
        exported = mujoco.MjModel.from_xml_path(str(path))
        inertia = exported.body_inertia
        np.testing.assert_allclose(inertia, expected.body_inertia, rtol=2e-5, atol=2e-11)
        np.testing.assert_allclose(exported.key_qpos, expected.key_qpos)
        np.testing.assert_allclose(exported.qpos0, expected.qpos0, atol=1e-6)


def test_numbers_without_effect_need_not_be_in_the_mjcf(tmp_path):
    """A cylinder has two sizes, a sphere one, and any axes across a body of revolution fit."""
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><geom type="cylinder" size=".03 .2 .1"/><site size=".01 .02 .03"/>
        <body><joint/><geom type="capsule" fromto=".01 .01 .01 .17 .17 .17" size=".031"/>
        <geom pos=".18 .18 .18" size=".04"/></body></worldbody></mujoco>"""
    )
    write_spec(spec, tmp_path)
    before, after = spec.compile(), mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert before.geom_size[0, 2] != after.geom_size[0, 2]
    assert before.site_size[0, 1] != after.site_size[0, 1]
    assert not np.allclose(before.body_iquat, after.body_iquat, atol=1e-3)
    after.body_iquat[1] = [1, 0, 0, 0]
    with pytest.raises(RuntimeError, match="writes no body_iquat"):
        compare(after, before, {"body_iquat"})


# A free body whose frame MuJoCo moves to its centre of mass
ALIGNED = """
<mujoco>
  <compiler {compiler}/>
  <worldbody>
    <camera name="front" pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="hammer" pos=".3 0 .4" euler="0 30 20"><freejoint {joint}/>
      <geom type="box" size=".1 .05 .05"/><geom name="end" pos=".2 .05 0" size=".05"/>
    </body>
    <body name="arm" pos="0 1 .5"><joint axis="0 1 0"/><geom size=".1" pos=".1 0 0"/></body>
  </worldbody>
</mujoco>
"""
OF_ALIGNED = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
parameters = [{{name = "mass", kind = "mass", objects = ["{body}"]}}]
"""


@pytest.mark.parametrize("body", ["hammer", "arm"])
@pytest.mark.parametrize(
    "where",
    [{"compiler": 'alignfree="true"', "joint": ""}, {"compiler": "", "joint": 'align="true"'}],
)
def test_a_free_body_that_mujoco_aligns_moves_as_in_the_tuned_world(where, body, tmp_path):
    xml, toml = ALIGNED.format(**where), OF_ALIGNED.format(body=body)
    paths, expected = exported_both_ways(xml, toml, tmp_path)
    for path in paths:
        moved = after_a_second(mujoco.MjModel.from_xml_path(str(path)))
        np.testing.assert_allclose(moved, after_a_second(expected), atol=1e-3, err_msg=path.name)


def test_what_mujoco_cannot_write_is_said_in_a_line(scene, tmp_path, monkeypatch):
    def refuse(*_):
        raise ValueError("Error: no word\nfor that")

    run, _ = a_run(tmp_path / "run", str(scene))
    monkeypatch.setattr(mujoco.MjSpec, "copy_back", refuse)
    with pytest.raises(InputError, match="cannot write the model as MJCF: Error: no word for"):
        export(ExportConfig(run_folder=run, out=tmp_path / "out"))


def test_inertias_that_no_body_has_are_refused(tmp_path):
    spec = mujoco.MjSpec.from_string("""<mujoco><worldbody><body name="plate"><freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .15"/></body></worldbody></mujoco>""")
    model = spec.compile()
    writer = ModelWriter(ParameterSpace([]), model)
    write_mjcf(spec, model, writer, tmp_path, [])
    model.body("plate").inertia[2] = 0.25
    with pytest.raises(InputError, match=r"of plate, 0\.1, 0\.1 and 0\.25 kg·m², are no body's"):
        write_mjcf(spec, model, writer, tmp_path, [])


def test_a_file_that_cannot_be_copied_is_said_as_what_it_is(scene, tmp_path, monkeypatch):
    def missing(*_):
        raise InputError("cannot copy a.obj, which the model needs: no such file")

    xml = (scene.parent / "scene.xml").read_text()
    mesh = '<asset><mesh name="a" file="a.obj"/></asset><worldbody>'
    (scene.parent / "scene.xml").write_text(xml.replace("<worldbody>", mesh))
    corners = "".join(f"v {x}\n" for x in ("0 0 0", "1 0 0", "0 1 0", "0 0 1"))
    (scene.parent / "a.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    run, _ = a_run(tmp_path / "run", str(scene))
    monkeypatch.setattr("simtune.export.mjcf._copy", missing)
    with pytest.raises(InputError, match=r"^cannot copy a\.obj"):
        export(ExportConfig(run_folder=run, out=tmp_path / "out"))


def test_an_attached_model_s_compiler_changes_no_tuned_value():
    hand = mujoco.MjSpec.from_string(
        BOUNDED.replace("<compiler", '<compiler inertiafromgeom="true"')
    )
    spec = mujoco.MjSpec()
    spec.attach(hand, prefix="left_", frame=spec.worldbody.add_frame())
    write_down_inferred(spec)
    spec.body("left_arm").mass = 0.3
    np.testing.assert_array_equal(spec.compile().body("left_arm").mass, 0.3)
