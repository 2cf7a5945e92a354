"""A robot on wheels that begins anywhere on a floor, which no reading may show."""

from pathlib import Path

import numpy as np
import pytest

from simtune.fit import Readings
from simtune.fit.readings.loop_setup import set_up_loop, where_starts_show
from simtune.real.observed import observed
from simtune.tasks import load_task

STEPS, STEP_S = 50, 0.04
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body name="car" pos="0 0 .1"><freejoint name="root"/>
      <geom type="box" size=".2 .15 .03" mass="3"/>
      <body pos="0 .18 0"><joint name="left" axis="0 1 0" damping=".05" armature=".01"/>
        <geom type="cylinder" size=".1 .02" euler="90 0 0" mass=".3"/></body>
      <body pos="0 -.18 0"><joint name="right" axis="0 1 0" damping=".05" armature=".01"/>
        <geom type="cylinder" size=".1 .02" euler="90 0 0" mass=".3"/></body>
      <geom type="sphere" size=".05" pos=".18 0 -.05" friction=".01" priority="1" mass=".1"/>
      <geom type="sphere" size=".05" pos="-.18 0 -.05" friction=".01" priority="1" mass=".1"/>
    </body>
    <body name="box" pos=".4 0 .06"><freejoint name="box"/>
      <geom type="box" size=".05 .3 .05" mass="2"/></body>
  </worldbody>
  <actuator>
    <velocity name="left" joint="left" kv=".1"/><velocity name="right" joint="right" kv=".1"/>
  </actuator>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.04
episode_steps = 50

[initial_state]
kind = "distribution"
[initial_state.joints]
root = { position = [[-0.3, 0.3], [-0.3, 0.3], [0.1, 0.1001]] }
BOX

[[sensors]]
name = "wheels"
joints = ["left", "right"]
noise = 0.01

[[parameters]]
name = "kv"
kind = "gain"
objects = ["left", "right"]
"""
ANYWHERE = "box = { position = [[0.35, 0.45], [-0.1, 0.1], [0.06, 0.0601]] }"
SAME = "box = { position = [[0.4, 0.4], [0, 0], [0.06, 0.06]] }"


def unseen_at(folder: Path, speed: float, box: str = ANYWHERE, turn: str = "") -> tuple[str, ...]:
    """What is unseen once wheels are replayed that turn so fast, in rad/s."""
    (folder / "scene.xml").write_text(SCENE)
    tune = TUNE.replace("0.1001]]", f"0.1001]]{turn}").replace("BOX", box)
    (folder / "tune.toml").write_text(tune)
    task = load_task(str(folder / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
    assert loop.unseen == ("root",)  # the box is not where the robot is
    read = np.repeat(speed * STEP_S * np.arange(STEPS + 1)[None, :, None], 2, 2)
    readings = Readings(np.full((1, STEPS, 2), 6.0), read)
    return where_starts_show(
        loop, readings, task.parameters.to_unit(task.parameters.nominal)
    ).unseen


@pytest.mark.parametrize(
    ("box", "unseen"), [(ANYWHERE, ()), (SAME, ("root",))], ids=["anywhere", "in the way"]
)
def test_a_box_that_begins_anywhere_is_not_in_the_robots_way(tmp_path, box, unseen):
    """One that does not may be: whether the robot strikes it depends on where that begins."""
    assert unseen_at(tmp_path, speed=5.0, box=box) == unseen


def test_worlds_that_both_diverge_do_not_tell_that_a_start_is_no_matter(tmp_path):
    assert unseen_at(tmp_path, speed=1e6) == ("root",)


def test_a_robot_that_faces_another_way_rolls_that_way(tmp_path):
    assert unseen_at(tmp_path, speed=5.0, turn=", turn = [-3, 3]") == ()
