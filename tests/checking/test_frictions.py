"""Why frictions do not show: what MuJoCo takes as a contact's friction is known."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.checking import check
from simtune.checking.frictions import unfelt_frictions
from simtune.config import CheckConfig
from simtune.tasks import load_task

SCENE = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -2 .3" xyaxes="1 0 0 0 0 1"/>
    <geom name="table" type="plane" size="2 2 .1" friction="{table}"/>
    <body name="block" pos="0 0 .1">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom name="block" type="box" size=".1 .1 .1" mass="1" friction=".3" {more}/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="x" gear="8" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
TUNING = """
model = "scene.xml"
camera = "front"
control_timestep_s = 0.05
episode_steps = 30
[[parameters]]
name = "friction"
kind = "friction"
objects = "block"
"""
OUTWEIGHED = (
    "its contacts have the friction of table: MuJoCo takes the larger one, or that of higher "
    'priority; give block a priority="1"'
)


@pytest.mark.parametrize(
    ("table", "more", "note"),
    [
        ("1", "", OUTWEIGHED),
        ("1", 'priority="1"', ""),
        (".2", "", ""),
        ("1", 'priority="-1"', OUTWEIGHED),
        ("1", 'priority="1" condim="1"', 'needs contacts of condim="3", and those of block have 1'),
        ("1", 'contype="0" conaffinity="0"', "block touches nothing in the states looked at"),
    ],
)
def test_the_reason_is_told_if_a_friction_does_not_show(tmp_path: Path, table, more, note):
    (tmp_path / "scene.xml").write_text(SCENE.format(table=table, more=more))
    (tmp_path / "tune.toml").write_text(TUNING)
    found = check(CheckConfig(task=str(tmp_path / "tune.toml"), episodes=2))
    friction = found["parameters"]["friction"]
    assert friction["note"] == note
    assert (friction["verdict"] == "does not show") == bool(note)


def test_a_flex_may_have_the_friction(tmp_path: Path):
    cloth = """<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".05 .05 .1" dim="2"
        pos="0 0 .2" mass=".1" radius=".01"><contact friction="1"/><edge equality="true"/>
        </flexcomp></worldbody>"""
    scene = SCENE.format(table=1, more="").replace("</worldbody>", cloth)
    (tmp_path / "scene.xml").write_text(scene)
    (tmp_path / "tune.toml").write_text(TUNING)
    simulator = load_task(str(tmp_path / "tune.toml")).simulator(image_size=64, views=())
    data = mujoco.MjData(simulator.model)
    state = np.empty(mujoco.mj_stateSize(simulator.model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(simulator.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    reasons = unfelt_frictions(simulator, state[None, None])
    assert "its contacts have the friction of a flex, table: " in reasons["friction"]
