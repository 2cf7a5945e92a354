"""Loops of a robot that its model may lack are hinted at where their joints begin anywhere."""

import numpy as np
import pytest

from simtune.checking.replays import RecordedReplays
from simtune.real.observed import observed
from simtune.tasks import load_task
from simtune.trajectory import Trajectory

LEG = """
<body name="thigh_{side}" pos="{x} 0 0"><joint name="hip_{side}" axis="0 1 0" damping="1"/>
  <geom fromto="0 0 0 0 0 -.14"/>
  <body pos="0 0 -.14"><joint name="knee_{side}" axis="0 1 0" damping="1"/>
    <geom fromto="0 0 0 0 0 -.22"/><site name="tip_{side}" pos="0 0 -.22"/></body></body>"""
FIVE_BAR = f"""
<mujoco><compiler angle="radian"/><option timestep=".002"/>
  <default><geom type="capsule" size=".01" mass=".2" contype="0" conaffinity="0"/></default>
  <worldbody>{LEG.format(x=-0.04, side="left")}{LEG.format(x=0.04, side="right")}</worldbody>
  <equality/>
  <actuator><position name="left" joint="hip_left"/><position name="right" joint="hip_right"/>
  </actuator>
</mujoco>"""
TUNE = """
model = "leg.xml"
control_timestep_s = 0.02
[actions]
mapping = "direct"
columns = ["left", "right"]
[[sensors]]
name = "hips"
joints = {joints}
columns = "measured"
[[parameters]]
name = "mass"
kind = "mass"
objects = "thigh_left"
"""
HIPS, ONE_HIP = ["hip_left", "hip_right"], ["hip_left"]
PENDULUM = '<body><joint name="{}" axis="0 1 0"/><geom fromto="0 0 0 0 0 -.1"/></body>'
TWO = PENDULUM.format("one") + PENDULUM.format("other")


@pytest.mark.parametrize(
    ("instead", "by", "joints", "is_said"),
    [
        ("", "", HIPS, True),
        (
            "<equality/>",
            '<equality><connect site1="tip_left" site2="tip_right"/></equality>',
            HIPS,
            0,
        ),
        ('knee_right"', 'knee_right" stiffness="5"', HIPS, False),
        ('knee_right" axis="0 1 0"', 'knee_right" type="slide" axis="0 0 1"', HIPS, False),
        ("", "", ONE_HIP, False),
        ('<site name="tip_left" pos="0 0 -.22"/>', TWO, [*HIPS, "knee_left", "knee_right"], False),
    ],
    ids=["open", "closed", "sprung", "slide", "one branch", "two pendulums on one shin"],
)
def test_unread_hinges_below_two_read_joints_may_close_a_loop(
    tmp_path, instead, by, joints, is_said
):
    (tmp_path / "leg.xml").write_text(FIVE_BAR.replace(instead, by) if instead else FIVE_BAR)
    (tmp_path / "tune.toml").write_text(TUNE.format(joints=joints))
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    actions, read = np.zeros((30, 2), np.float32), {"hips": np.zeros((31, len(joints)))}
    episode = Trajectory(np.zeros((31, 0, 0, 3), np.uint8), actions, 0.02, read)
    said = RecordedReplays(simulator, seen, [episode], ["walk"]).start_warnings()
    hints = [warning for warning in said if warning.startswith("If ")]
    assert len(hints) == is_said
    if is_said:
        assert hints[0].startswith("If knee_left, knee_right close a loop on the robot")
