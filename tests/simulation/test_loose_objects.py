"""Which objects lie loose, and which joints nothing drives, where a model ties some of them."""

import mujoco
import numpy as np
import pytest

from simtune.simulation.driven_joints import driven_joints
from simtune.simulation.loose_objects import gliding_joints, loose_joints, passive_joints

SCENE = """
<mujoco>
  <worldbody>
    <site name="hook" pos="0 0 1"/>
    <body name="left"><joint name="left" type="slide" axis="1 0 0"/><geom size=".01"/></body>
    <body name="right"><joint name="right" type="slide" axis="-1 0 0"/><geom size=".01"/></body>
    <body name="thumb"><joint name="thumb"/><geom size=".01"/></body>
    <body name="lid"><joint name="lid"/><geom size=".01"/></body>
    <body name="box" pos="1 0 0"><freejoint name="box"/><geom size=".1"/><site name="top"/></body>
    <body name="ball" pos="2 0 0"><freejoint name="ball"/><geom name="ball" size=".1"/></body>
  </worldbody>
  TIES
  <actuator>DRIVE</actuator>
</mujoco>"""
FINGERS = "<equality><joint joint1='right' joint2='left'/></equality>"
ON_LEFT = "<position name='grip' joint='left' kp='20'/>"


def model_with(ties: str, drive: str = ON_LEFT) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE.replace("TIES", ties).replace("DRIVE", drive))


def names(model: mujoco.MjModel, joints: np.ndarray) -> list[str]:
    return [model.joint(joint).name for joint in joints]


@pytest.mark.parametrize(
    ("ties", "loose"),
    [
        ("", ["box", "ball"]),
        (FINGERS, ["box", "ball"]),
        ("<tendon><fixed><joint joint='left' coef='1'/></fixed></tendon>", ["box", "ball"]),
        ("<equality><weld body1='box' body2='left'/></equality>", ["ball"]),
        ("<equality><weld active='false' body1='box' body2='left'/></equality>", ["box", "ball"]),
        ("<equality><connect body1='ball' anchor='0 0 0'/></equality>", ["box"]),
        ("<equality><connect site1='top' site2='hook'/></equality>", ["ball"]),
        ("<tendon><spatial><site site='hook'/><site site='top'/></spatial></tendon>", ["ball"]),
        (
            "<tendon><spatial><site site='hook'/><geom geom='ball'/><site site='hook'/></spatial>"
            "</tendon>",
            ["box"],
        ),
    ],
)
def test_an_object_is_loose_unless_something_ties_it_itself(ties, loose):
    model = model_with(ties)
    assert names(model, loose_joints(model)) == loose


BLOCK = """<mujoco>
  <worldbody>
    <body name="pusher"><joint name="pusher_x" type="slide"/><joint name="pusher_y" type="slide"/>
      <geom size=".01"/></body>
    <body name="block"><joint name="block_x" type="slide" axis="1 0 0" SPRING/>
      <joint name="block_y" type="slide" axis="0 1 0"/><joint name="turn"/><geom size=".01"/></body>
    <body name="drawer"><joint name="drawer" type="slide"/><geom size=".01"/></body>
  </worldbody>
  <actuator><position joint="pusher_x"/></actuator>
</mujoco>"""


@pytest.mark.parametrize(
    ("spring", "measured", "gliding"),
    [
        ("", [], ["block_x", "block_y", "turn"]),
        ("", [4], []),
        ("stiffness='1'", [], []),
    ],
)
def test_a_block_on_slides_that_nothing_drives_springs_or_measures_glides(
    spring, measured, gliding
):
    model = mujoco.MjModel.from_xml_string(BLOCK.replace("SPRING", spring))
    assert names(model, gliding_joints(model, measured)) == gliding


@pytest.mark.parametrize("parent", ["<body name='table'><geom size='.1'/>", "<body name='scene'>"])
def test_a_block_on_a_body_that_never_moves_glides(parent):
    """An arm on the same one changes nothing: each is in a kinematic tree of its own."""
    scene = BLOCK.replace("SPRING", "").replace("<worldbody>", f"<worldbody>{parent}")
    scene = scene.replace("</worldbody>", "</body></worldbody>")
    model = mujoco.MjModel.from_xml_string(scene)
    assert names(model, gliding_joints(model)) == ["block_x", "block_y", "turn"]


@pytest.mark.parametrize(
    ("ties", "drive", "passive"),
    [
        ("", ON_LEFT, ["right", "thumb", "lid"]),
        (FINGERS, ON_LEFT, ["thumb", "lid"]),
        (
            "<equality><joint joint1='thumb' joint2='right'/>"
            "<joint joint1='right' joint2='left'/></equality>",
            ON_LEFT,
            ["lid"],
        ),
        (
            "<tendon><fixed name='both'><joint joint='left' coef='.5'/>"
            "<joint joint='right' coef='.5'/></fixed></tendon>",
            "<position name='grip' tendon='both' kp='20'/>",
            ["thumb", "lid"],
        ),
    ],
)
def test_a_joint_is_driven_also_by_a_tendon_or_another_joint(ties, drive, passive):
    model = model_with(ties, drive)
    assert names(model, passive_joints(model)) == passive


FLYING = """<mujoco>
  <worldbody>
    <site name="still"/>
    <body name="drone"><freejoint name="drone"/><geom size=".1"/><site name="thruster"/></body>
    <body name="ball"><freejoint name="ball"/><geom size=".1"/></body>
    <body name="craft">
      <joint name="craft_x" type="slide" axis="1 0 0"/>
      <joint name="craft_y" type="slide" axis="0 1 0"/><geom size=".1"/><site name="fan"/></body>
    <body name="upper"><joint name="shoulder"/><geom size=".1"/><site name="collar"/>
      <body name="lower"><joint name="elbow"/><geom size=".1"/><site name="hand"/></body></body>
    <body name="knob"><joint name="knob" type="ball"/><geom size=".1"/><site name="top"/></body>
  </worldbody>
  <tendon><spatial name="cable"><site site="collar"/><site site="hand"/></spatial></tendon>
  <actuator>DRIVE</actuator>
</mujoco>"""


@pytest.mark.parametrize(
    ("drive", "driven"),
    [
        ("<motor joint='drone' gear='0 0 1 0 0 0'/>", ["drone"]),
        ("<motor site='thruster' gear='0 0 1 0 0 0'/>", ["drone"]),
        ("<motor site='fan' gear='1 0 0 0 0 0'/>", ["craft_x", "craft_y"]),
        ("<motor site='hand' gear='0 0 1 0 0 0'/>", ["shoulder", "elbow"]),
        ("<motor site='hand' refsite='collar' gear='0 0 1 0 0 0'/>", ["elbow"]),
        ("<motor site='hand' refsite='fan' gear='1 0 0 0 0 0'/>", None),
        ("<motor tendon='cable'/>", ["elbow"]),
        ("<orientation joint='knob'/>", ["knob"]),
        ("<orientation site='top' refsite='still'/>", ["knob"]),
        ("<adhesion body='ball' ctrlrange='0 1'/>", []),
    ],
)
def test_what_thrusters_or_forces_at_sites_drive_is_not_loose(drive, driven):
    model = mujoco.MjModel.from_xml_string(FLYING.replace("DRIVE", drive))
    driven = ["craft_x", "craft_y", "shoulder", "elbow"] if driven is None else driven
    assert names(model, sorted(driven_joints(model))) == driven
    loose = [name for name in ("drone", "ball") if name not in driven]
    assert names(model, loose_joints(model)) == loose
    others = ["craft_x", "craft_y", "shoulder", "elbow", "knob"]
    assert names(model, passive_joints(model)) == [n for n in others if n not in driven]
    gliding = [] if "craft_x" in driven else ["craft_x", "craft_y"]
    assert names(model, gliding_joints(model)) == gliding
