"""Actuators of sites and tendons: their gears, units, and what `check` says of them."""

import numpy as np
import pytest

from simtune.checking import check, table
from simtune.checking.servos.commands import on_tendons
from simtune.config import CheckConfig

SCENE = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1">
      <freejoint name="root"/>
      <geom name="base" type="box" size=".1 .1 .02" mass="1"/>
      <site name="m1" pos=".1 0 0"/>
    </body>
    <body name="finger">
      <joint name="finger" type="slide" axis="1 0 0" armature=".1" damping="1"/>
      <geom size=".01" mass=".1"/>
    </body>
    <body name="knuckle" pos="0 1 0">
      <joint name="knuckle" axis="0 1 0" armature=".01" damping=".01"/>
      <geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass=".1"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="pull"><joint joint="finger" coef="1"/></fixed>
    <fixed name="bend"><joint joint="knuckle" coef="1"/></fixed>
  </tendon>
  <actuator>
    <general name="up" site="m1" gear="0 0 1 0 0 .016" gainprm="5" ctrlrange="0 1"/>
    <position name="grip" tendon="pull" kp="200" kv="8" ctrlrange="-1 1"/>
    <position name="curl" tendon="bend" kp="2" kv=".1" ctrlrange="-1 1"/>
    <position name="slide" joint="finger" kp="100" kv="8" ctrlrange="-1 1"/>
    <velocity name="turn" joint="knuckle" kv="1" ctrlrange="-1 1"/>
    <motor name="push" joint="finger" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
HEAD = """model = "scene.xml"
control_timestep_s = 0.05
fixed_joints = ["root"]
[[sensors]]
name = "encoders"
joints = "finger"
columns = "measured"
"""
PARAMETER = "[[parameters]]\nname = 'p'\nkind = '{}'\nobjects = '{}'\n"


def test_a_gear_in_other_components_is_refused_with_what_to_declare(refuses):
    said = 'up has a gear of 0 in component 0, .* not in 2 and 5: say field = "actuator_gear" and'
    refuses(HEAD + PARAMETER.format("gear", "up"), 11, f'{said} component = 2, or kind = "gain"')


def test_a_gear_in_another_component_is_tuned_by_it(load):
    declared = PARAMETER.format("gear", "up").replace("kind = 'gear'", "field = 'actuator_gear'")
    (parameter,) = load(f"{HEAD}{declared}component = 5\n").parameters
    assert parameter.nominal == 0.016


@pytest.mark.parametrize(
    ("kind", "actuator", "unit"),
    [
        ("gain", "grip", "N/m"),
        ("gain", "curl", "N·m/rad"),
        ("gain", "slide", "N/m"),
        ("gain", "turn", "N·m·s/rad"),
        ("gain", "push", "1"),
        ("gain_damping", "grip", "N·s/m"),
        ("gain_damping", "curl", "N·m·s/rad"),
        ("gain_damping", "slide", "N·s/m"),
    ],
)
def test_a_gain_has_the_unit_of_what_it_moves(load, kind, actuator, unit):
    (parameter,) = load(HEAD + PARAMETER.format(kind, actuator)).parameters
    assert parameter.unit == unit


def test_only_commanded_servos_on_tendons_are_found(load):
    actions = "[actions]\nactuators = ['grip', 'slide', 'push']\n"
    task = load(HEAD + actions + PARAMETER.format("gain", "grip"))
    assert on_tendons(task.simulator(image_size=16)) == ["grip"]


@pytest.mark.thorough
def test_servos_on_tendons_are_said_to_be_in_no_table(load, folder):
    actions = "[actions]\nactuators = ['grip', 'turn']\n"
    load(HEAD + actions + PARAMETER.format("gain", "grip"))
    times_s = 0.05 * np.arange(41)
    waves = [np.sin(3 * (times_s - late_s)) for late_s in (0, 1, 0.1)]
    (folder / "real").mkdir()
    rows = np.transpose([times_s, *waves])
    header = "time,grip,turn,measured.finger"
    np.savetxt(folder / "real" / "a.csv", rows, delimiter=",", header=header, comments="")
    said = table(check(CheckConfig(task=str(folder / "tune.toml"), real=str(folder / "real"))))
    assert "Not compared with their commands: servos on tendons (grip)." in said
