"""What `check` says of things that begin elsewhere in simulated worlds than on film."""

import numpy as np
import pytest

from simtune.cameras.views import View
from simtune.checking import check
from simtune.checking.begins_elsewhere import elsewhere_warnings, out_of_sight
from simtune.config import CheckConfig

# A pusher and a puck; the camera sees some 2 m from side to side.
SCENE = """
<mujoco>
  <worldbody>
    <camera name="above" pos="0 0 2" fovy="53"/>
    <body name="pusher" pos="-.5 0 0">
      <joint name="push" type="slide" axis="1 0 0" range="-.4 .4" damping="1"/>
      <geom type="box" size=".05 .2 .05" mass="1"/>
    </body>
    <body name="puck">
      <joint name="puck_x" type="slide" axis="1 0 0" range="-9 9" damping="1"/>
      <joint name="puck_y" type="slide" axis="0 1 0" range="-9 9" damping="1"/>
      <geom name="puck" type="cylinder" size=".1 .05" mass=".2"/>
    </body>
  </worldbody>
  <actuator><motor joint="push" gear="2" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
TUNING = """model = "scene.xml"
control_timestep_s = 0.05
episode_steps = 20
camera = "above"
[initial_state]
kind = "distribution"
[initial_state.joints]
push = { position = [-0.1, 0.1] }
PLACE
[[parameters]]
name = "puck_damping"
kind = "damping"
objects = ["puck_x", "puck_y"]
[[parameters]]
name = "puck"
kind = "colour"
objects = "puck"
[[parameters]]
name = "push_damping"
kind = "damping"
objects = "push"
"""
ANYWHERE = "puck_x = { position = [-9, 9] }\npuck_y = { position = [-9, 9] }"
IN_SIGHT = "puck_x = { position = [0.5, 0.7] }\npuck_y = { position = [-0.5, 0.5] }"
IN_ITS_WAY = "puck_x = { position = [-0.25, -0.25] }\npuck_y = { position = [-0.1, 0.1] }"


def told(load, place: str, verdict: str = "does not show", are_recorded: bool = True) -> list[str]:
    """The warnings, if this is the verdict on all parameters."""
    simulator = load(TUNING.replace("PLACE", place)).simulator(image_size=64, views=[View("above")])
    worlds, rng = np.tile(simulator.space.nominal, (8, 1)), np.random.default_rng(0)
    states = simulator.roll_out(worlds, np.ones((8, 20, 1)), rng).states
    said = {name: {"verdict": verdict} for name in simulator.space.names}
    hidden = out_of_sight(simulator, 0)
    return elsewhere_warnings(simulator, states, hidden, said, 0, are_recorded=are_recorded)


def test_a_thing_that_begins_out_of_sight_is_named_once_with_all_that_it_hides(load):
    (said,) = told(load, ANYWHERE)
    assert said.startswith("puck is outside the picture in 6")
    assert "of 64 simulated starts, so hardly anything tells of puck_damping, puck_r," in said
    assert "does [initial_state] say where it begins" in said
    assert told(load, ANYWHERE, "shows weakly") == [], "it comes into the picture"


def test_an_object_that_recorded_actions_do_not_reach_is_named(load):
    (said,) = told(load, IN_SIGHT)
    assert said.startswith("puck_damping: the recorded actions move puck in 0 of 8 simulated")
    assert told(load, IN_SIGHT, are_recorded=False) == []
    assert told(load, IN_SIGHT, "shows clearly") == []
    assert told(load, IN_ITS_WAY) == []


@pytest.mark.thorough
def test_check_gives_the_reason_in_place_of_calling_it_impossible(load, folder):
    load(TUNING.replace("PLACE", ANYWHERE))  # writes the file
    found = check(CheckConfig(task=str(folder / "tune.toml"), episodes=2))
    assert found["parameters"]["puck_damping"]["verdict"] == "does not show"
    assert "puck is outside the picture in" in found["parameters"]["puck_damping"]["note"]
    assert "puck" not in found["parameters"]["push_damping"]["note"]
    assert any(said.startswith("puck is outside the picture") for said in found["warnings"])
