"""Joints that the model keeps at their limits: what check says of them."""

import pytest

from simtune.checking import check
from simtune.config import CheckConfig

SCENE = """
<mujoco>
  <compiler angle="{angle}"/>
  <worldbody>
    <camera name="front" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0" damping=".05" range="-1.6 1.6" limited="true"/>
      <geom name="upper" type="capsule" fromto="0 0 0 .5 0 0" size=".04" mass="1"/>
      <body name="hand" pos=".5 0 0">
        <joint name="wrist" axis="0 1 0" damping=".01" limited="true" range="-{wrist} {wrist}"/>
        <geom name="palm" type="capsule" fromto="0 0 0 .2 0 0" size=".03" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="shoulder" kp="60" kv="3" ctrlrange="-1.4 1.4"/></actuator>
</mujoco>
"""
TUNING = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
episode_steps = 60
[[parameters]]
name = "palm_mass"
kind = "mass"
objects = "hand"
"""


@pytest.fixture
def said_of(tmp_path):
    """What check says of joints at their limits, in a scene whose actions drive some actuators."""

    def said_of(scene: str, *driven: str) -> list[str]:
        (tmp_path / "scene.xml").write_text(scene)
        actions = f"[actions]\nactuators = {list(driven)}\n" if driven else ""
        (tmp_path / "tune.toml").write_text(TUNING.replace("[[", f"{actions}[[", 1))
        found = check(CheckConfig(task=str(tmp_path / "tune.toml"), episodes=2))
        assert found["task"] == tmp_path.name  # the file is called tune.toml
        return [warning for warning in found.get("warnings", ()) if "at its limits" in warning]

    return said_of


def test_what_no_action_drives_may_be_at_its_limits(said_of):
    """As a gripper that is held shut while an arm moves."""
    holds = '<position name="hold" joint="wrist" kp=".5" kv=".01"/></actuator>'
    scene = SCENE.format(angle="radian", wrist=0.01).replace("</actuator>", holds)
    assert said_of(scene, "servo") == []
    (said,) = said_of(scene, "servo", "hold")
    assert said.startswith("joint wrist is at its limits")


def test_a_range_of_many_degrees_is_meant_so(said_of):
    scene = SCENE.format(angle="degree", wrist=1e-4)
    scene = scene.replace('range="-1.6 1.6"', 'range="-20 20"')
    (said,) = said_of(scene.replace("1.4 1.4", "5 -4"))  # sent beyond it, to where it hangs
    assert said.startswith("joint shoulder is at its limits, -0.349 to 0.349 rad, in ")
    assert said.endswith("so actions hardly move it")


@pytest.mark.parametrize(("angle", "is_stuck"), [("degree", True), ("radian", False)])
def test_a_range_in_degrees_where_radians_are_meant_is_noticed(said_of, angle, is_stuck):
    wrist = 1e-4  # hangs at its limit, but nothing drives it: no one expects it to move
    said = said_of(SCENE.format(angle=angle, wrist=wrist))
    assert len(said) == is_stuck
    if is_stuck:
        assert said[0].startswith("joint shoulder is at its limits, -0.0279 to 0.0279 rad, in ")
        assert said[0].endswith("in degrees where radians are meant?")
