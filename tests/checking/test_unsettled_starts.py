"""Replays that begin where no robot could rest, and contacts that it may not have."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from simtune.checking.check import check
from simtune.checking.replayed_contacts import Touching, in_words
from simtune.checking.replays import RecordedReplays
from simtune.checking.sensitive_starts import growth_warnings
from simtune.config import CheckConfig, TuneConfig
from simtune.experiment.experiment import build_experiment
from simtune.real.observed import observed
from simtune.tasks import load_task
from simtune.trajectory import Trajectory

# A box that stands on a floor, and whose servo turns an arm above it
SCENE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="trunk" pos="0 0 {height}">
      {base}
      <geom name="trunk" type="box" size=".1 .1 .1" mass="2"/>
      <body name="arm" pos="0 0 .2">
        <joint name="elbow" axis="0 0 1" damping=".1"/>
        <geom name="arm" type="box" size=".05 .02 .02" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <actuator><{servo} name="elbow" joint="elbow"/></actuator>
  <keyframe><key name="stand" qpos="{pose} 0"/></keyframe>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.02
{start}

[[sensors]]
name = "angle"
joints = "elbow"
columns = "measured.elbow"
noise = 0.001

[[parameters]]
name = "mass"
kind = "mass"
objects = "arm"
"""
STAND = '[initial_state]\nkind = "keyframe"\nkeyframe = "stand"'
SPEED = """
[[sensors]]
name = "speed"
joints = "elbow"
quantity = "velocity"
columns = "measured.speed"
"""
ACTIONS = '\n[actions]\nmapping = "direct"\ncolumns = ["elbow"]\n'
FREE = '<freejoint name="root"/>'
SLIDES = '<joint name="up" type="slide" axis="0 0 1"/><joint name="roll" axis="1 0 0"/>'
SERVO = 'position kp="5"'


def replays(
    folder: Path,
    base: str,
    pose: str,
    start: str = STAND,
    servo: str = SERVO,
    moves: float = 0.0,
    scene: str = SCENE,
    speed: np.ndarray | None = None,
    steps: int = 30,
) -> RecordedReplays:
    """Of two episodes in which the elbow moves by so many rad at once.

    `speed`: (steps + 1, 1) readings of its velocity.
    """
    height = 0.1 if base == SLIDES else 0.0
    filled = scene.format(base=base, pose=pose, servo=servo, height=height)
    (folder / "scene.xml").write_text(filled)
    (folder / "tune.toml").write_text(TUNE.format(start=start) + SPEED * (speed is not None))
    task = load_task(str(folder / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    read = {"angle": moves * np.minimum(np.arange(steps + 1) / 4, 1.0)[:, None]}
    read |= {} if speed is None else {"speed": speed}
    actions = np.zeros((steps, simulator.model.nu), np.float32)
    episode = Trajectory(np.zeros((steps + 1, 0, 0, 3), np.uint8), actions, 0.02, read)
    return RecordedReplays(simulator, seen, [episode] * 2, ["walk0", "walk1"])


@pytest.mark.parametrize(
    ("base", "pose", "said"),
    [
        (FREE, "0 0 .1 1 0 0 0", None),
        (FREE, "0 0 .13 1 0 0 0", '["root"]'),
        (SLIDES, "0 0", None),
        (SLIDES, ".03 0", '["up", "roll"]'),
    ],
)
def test_a_base_that_begins_above_the_floor_is_said_to_fall(tmp_path, base, pose, said):
    found = replays(tmp_path, base, pose).start_warnings()
    assert len(found) == bool(said)
    if said:
        assert found[0].startswith("trunk does not begin at rest")
        assert "walk0, walk1 (2 of 2 episodes) it falls by 3" in found[0]  # mm, and it sinks in
        assert f"fixed_joints = {said}" in found[0]


def test_a_base_in_the_floor_is_thrown_up(tmp_path):
    (found,) = replays(tmp_path, FREE, "0 0 .05 1 0 0 0").start_warnings()
    assert "it is thrown up by" in found


def test_of_a_robot_in_motion_only_a_long_fall_is_told(tmp_path):
    """It may hop, and then falls some millimetres like the robot."""
    assert not replays(tmp_path, FREE, "0 0 .13 1 0 0 0", moves=0.5).start_warnings()
    (found,) = replays(tmp_path, FREE, "0 0 2 1 0 0 0", moves=0.5).start_warnings()
    assert "it falls by 4" in found  # g/2 · (.3 s)² = 441 mm


def test_what_first_commands_do_not_hold_is_not_judged(tmp_path):
    assert not replays(tmp_path, FREE, "0 0 .13 1 0 0 0", servo="motor").start_warnings()


def test_noise_of_velocities_is_no_motion(tmp_path):
    """.05 rad/s are not .05 rad; and what turns at 1 rad/s moves by .1 rad in .1 s."""
    noise = 0.05 * np.random.default_rng(0).normal(size=(31, 1))
    (found,) = replays(tmp_path, FREE, "0 0 .18 1 0 0 0", speed=noise).start_warnings()
    assert "it falls by 8" in found  # mm
    assert not replays(tmp_path, FREE, "0 0 .18 1 0 0 0", speed=1 + noise).start_warnings()


@pytest.mark.parametrize(
    ("servo", "beside", "is_said"),
    [
        (SERVO, '<velocity name="damper" joint="elbow" kv=".1"/>', True),
        (SERVO, '<motor name="torque" joint="elbow"/>', True),
        ('intvelocity kp="5" actrange="-1 1"', "", True),
        ('velocity kv="5"', "", False),
        (SERVO, '<motor name="lift" site="rotor" gear="0 0 1 0 0 0"/>', False),
        (SERVO, '<adhesion name="cup" body="arm" gain="1" ctrlrange="0 1"/>', False),
        (SERVO, '<motor name="nothing" site="elsewhere" gear="0 0 1 0 0 0"/>', True),
    ],
    ids=["damper", "torque", "intvelocity", "speed", "rotor", "suction", "elsewhere"],
)
def test_a_joint_is_held_if_any_actuator_holds_it_and_a_drone_may_hold_itself(
    tmp_path, servo, beside, is_said
):
    scene = SCENE.replace("<actuator>", "<actuator>" + beside)
    scene = scene.replace("{base}", '{base}<site name="rotor"/>')
    scene = scene.replace("<geom name", '<site name="elsewhere"/><geom name', 1)
    found = replays(tmp_path, FREE, "0 0 .13 1 0 0 0", servo=servo, scene=scene).start_warnings()
    assert len(found) == is_said


def test_where_on_a_floor_a_base_begins_is_not_told_if_no_reading_shows_it(tmp_path):
    (falls,) = replays(tmp_path, FREE, "0 0 .1 1 0 0 0", start="").start_warnings()
    assert falls.startswith("trunk does not begin at rest")  # at the height of the model's pose


def test_check_says_that_a_base_may_begin_as_it_likes(tmp_path):
    """The arm hangs to one side, and turns as the trunk leans."""
    off_centre = SCENE.replace('<geom name="arm"', '<geom name="arm" pos=".2 0 0"')
    start = '[initial_state]\nkind = "distribution"\n[initial_state.joints]\n'
    start += "roll = { position = [-0.5, 0.5] }"
    found = replays(tmp_path, SLIDES, "0 0", start=start, scene=off_centre).start_warnings()
    assert found[0].startswith("Where roll begins no sensor measures")
    assert "nothing that they tell is called identified" in found[0]


def test_check_and_tune_warn_of_a_base_that_falls(tmp_path):
    replays(tmp_path, FREE, "0 0 .13 1 0 0 0", start=STAND + ACTIONS)
    real = tmp_path / "real"
    real.mkdir()
    turns = [f"{t / 50},{t > 10:d},{min(max(t - 10, 0) / 10, 1)}" for t in range(40)]
    (real / "turn.csv").write_text("\n".join(["time,elbow,measured.elbow", *turns]))
    task = str(tmp_path / "tune.toml")
    checked = check(CheckConfig(task=task, real=real))["warnings"]
    config = TuneConfig(task=task, real=str(real), out=tmp_path / "run")
    tuned = build_experiment(config)
    for warnings in (checked, tuned.warnings(tuned.recordings)):
        falls = [warning for warning in warnings if "turn (1 of 1 episode) it falls" in warning]
        assert len(falls) == 1


def test_what_touches_in_replays_is_named(tmp_path, monkeypatch):
    stands = replays(tmp_path, FREE, "0 0 .13 1 0 0 0")
    assert stands.contacts([1]) == [Touching(("trunk", "floor"), (0,))]
    assert stands.contacts([]) == []
    # It falls for √(2 · 1.9 / 9.81) s = 0.62 s; contacts are looked for as long as growth is
    falls = replays(tmp_path, FREE, "0 0 2 1 0 0 0", steps=40)
    assert falls.contacts([0, 1]) == [Touching(("trunk", "floor"), (0, 1))]
    monkeypatch.setattr("simtune.checking.replays.LONGEST_S", 0.5)
    assert falls.contacts([0, 1]) == []


def test_what_a_robot_stands_on_from_the_beginning_is_not_named(tmp_path):
    stands = replays(tmp_path, FREE, "0 0 .1 1 0 0 0")
    assert stands.contacts([0, 1]) == []
    # An arm that is mounted is not carried by what it touches: its model may be wrong
    mounted = '<joint name="roll" axis="1 0 0"/>'
    scene = SCENE.replace('pos="0 0 {height}"', 'pos="0 0 .099"')
    mounts = replays(tmp_path, mounted, "0", scene=scene)
    assert mounts.contacts([0, 1]) == [Touching(("trunk", "floor"), (0, 1))]


BOX = (
    '<body name="box" pos="{}"><freejoint/><geom name="box" type="box" size=".05 .05 .05"/></body>'
)


def beside_a_box(folder: Path, place: str, start: str, moves: str = "") -> RecordedReplays:
    """An arm that is mounted beside two free boxes in the air, one of them far away."""
    boxes = BOX.format(place) + BOX.format("3 0 .2").replace('"box"', '"far"', 2) + moves
    scene = SCENE.replace("</worldbody>", f"{boxes}</worldbody>").replace(' {pose} 0"', ' 0"')
    pose = f"0 {place} 1 0 0 0 3 0 .2 1 0 0 0"
    scene = scene.replace('qpos="{pose} 0"', f'qpos="{pose}"').replace("{height}", ".1")
    return replays(folder, "", "", start=start, scene=scene)


def test_objects_that_the_robot_does_not_touch_are_not_named(tmp_path):
    """Such as those that were put away and fall there."""
    assert beside_a_box(tmp_path, "1 0 .2", start="").contacts([0, 1]) == []
    assert beside_a_box(tmp_path, "1 0 .2", start=STAND).contacts([0, 1]) == []


def test_objects_that_the_robot_touches_are_named_with_what_else_they_touch(tmp_path):
    # It falls from the arm's end to the floor, and on the way strikes the arm
    on_the_arm = beside_a_box(tmp_path, ".09 0 .4", start=STAND).contacts([0, 1])
    touched = {frozenset(its.geoms) for its in on_the_arm}
    assert frozenset(("arm", "box")) in touched
    assert not any("far" in pair for pair in touched)
    mocap = '<body mocap="true" pos="1.03 0 .1"><geom name="hand" size=".03"/></body>'
    by_hand = beside_a_box(tmp_path, "1 0 .3", start=STAND, moves=mocap).contacts([0, 1])
    assert Touching(("box", "floor"), (0, 1)) in by_hand


def test_of_geoms_that_touch_the_same_all_are_told_together():
    found = [Touching((foot, "floor"), (0, 1)) for foot in ("left", "right")]
    found.append(Touching(("left", "right"), (1,)))
    assert in_words(found, ["walk0", "walk1"]) == (
        "left, right touch floor in 2 of 2 episodes; left touches right in 1 of 2 episodes "
        "(walk1): is it so on the robot?"
    )
    growth = np.array([20.0, 1.0, 20.0])
    (warning,) = growth_warnings(growth, ["walk0", "rest", "walk1"], found)
    assert "2 of 3 episodes replayed (walk0, walk1)" in warning
    assert warning.endswith(
        "In these replays left, right touch floor in 2 of 2 episodes; left touches right in 1 of 2 "
        "episodes (walk1): is it so on the robot?"
    )


def test_the_recipe_of_the_docs_settles_a_keyframe(tmp_path):
    """docs/joint-readings.md, "Robots that stand"."""
    page = (Path(__file__).parents[2] / "docs/joint-readings.md").read_text()
    recipe = page[page.index("## Robots that stand") :].split("```python\n")[1].split("```")[0]
    replays(tmp_path, FREE, "0 0 .13 1 0 0 0")
    recipe = recipe.replace("robot.xml", str(tmp_path / "scene.xml"))
    recipe = recipe.replace("settled.xml", str(tmp_path / "settled.xml"))
    for name in ("stand", "settled"):
        exec(recipe, {})
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "settled.xml"))
        assert model.key_qpos[0, 2] == pytest.approx(0.1, abs=1e-3)
        assert model.key(name).id == 0
        spec = mujoco.MjSpec.from_file(str(tmp_path / "scene.xml"))
        for key in spec.keys:  # then without any
            spec.delete(key)
        (tmp_path / "scene.xml").write_text(spec.to_xml())
