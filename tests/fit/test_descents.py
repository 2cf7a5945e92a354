"""Descents on readings from starts beside the best, with derivatives of the best at first."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simtune.budget import Budget
from simtune.fit import Guess, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments
from simtune.real.observed import observed
from simtune.tasks import load_task

SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="drone">
    <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <joint name="pitch" axis="0 1 0"/>
    <inertial pos="0 0 0" mass="1" diaginertia=".006 .007 .011"/>
    <site name="ahead" pos=".12 0 0"/><site name="behind" pos="-.12 0 0"/>
  </body></worldbody>
  <actuator>
    <motor name="m1" site="ahead" gear="0 0 12 0 0 0" ctrlrange="0 1"/>
    <motor name="m2" site="behind" gear="0 0 12 0 0 0" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.02
[[sensors]]
name = "place"
joints = ["x", "z"]
noise = 5e-4
offset = 0
[[sensors]]
name = "attitude"
joints = ["pitch"]
noise = 2e-3
offset = 0
[[parameters]]
name = "inertia"
field = "body_inertia"
component = 1
objects = "drone"
[[parameters]]
name = "thrust"
kind = "gain"
objects = "m*"
[[parameters]]
name = "lag"
kind = "lag"
objects = "m*"
nominal = 0.05
"""
NOISE = np.array([5e-4, 5e-4, 2e-3])
HOVER = 9.81 / 24


def flown(folder: Path) -> tuple[OutputErrorMethod, Readings, np.ndarray]:
    """A method, readings of four flights of .8 s, and what they were flown with."""
    (folder / "scene.xml").write_text(SCENE)
    (folder / "tune.toml").write_text(TUNE)
    task, rng = load_task(str(folder / "tune.toml")), np.random.default_rng(0)
    simulator, nominal = task.simulator(image_size=16), task.parameters.nominal
    lift, turn = np.repeat(rng.normal(size=(2, 4, 10, 1)), 4, 2)
    actions = HOVER * (1 + 0.1 * lift) + 0.03 * turn * [1, -1]
    places = simulator.state_space.positions_and_velocities(
        simulator.roll_out(np.tile(nominal, (4, 1)), actions, rng).states
    )[..., :3]
    readings = Readings(actions, places + NOISE * rng.normal(size=places.shape))
    seen, unit = observed(task, None, is_simulated=False), task.parameters.to_unit(nominal)
    loop = set_up_loop(simulator, seen, nominal)
    return OutputErrorMethod(loop, np.zeros(3, bool), unit), readings, unit


@pytest.mark.parametrize("away", [0.06, -0.06])
def test_derivatives_that_are_wrong_do_not_hold_a_descent_up(tmp_path: Path, away: float):
    """In a group, those that are no reading's main ones are kept, but for a few iterations only."""
    (method, readings, unit), stage = flown(tmp_path), ReplayStage(15)
    best = method.descend(readings, Guess(unit, np.zeros(3)), stage, Budget())
    assert best.slopes is not None
    wrong = replace(best, slopes=best.slopes._replace(by_start=0 * best.slopes.by_start))
    begin = Guess(best.unit + away, np.zeros(3))
    again = method.descend(readings, begin, stage, Budget(), wrong)
    assert again.log_rms == pytest.approx(best.log_rms, abs=1e-3)
    np.testing.assert_allclose(again.unit, best.unit, atol=1e-3)


@pytest.mark.parametrize("away", [0.06, -0.06])
def test_motors_run_where_a_segment_begins_as_the_lag_that_is_found_has_it(tmp_path, away):
    """As the first guess of a lag has it, the descent would end next to that."""
    method, readings, unit = flown(tmp_path)
    parts = Segments(np.repeat(np.arange(4), 4), np.tile([0, 10, 20, 30], 4), np.full(16, 10))
    stage = ReplayStage(15, parts, goes_on=True)
    first, other = (
        method.descend(readings, Guess(unit + np.array([0, 0, off]), np.zeros(3)), stage, Budget())
        for off in (0.0, away)
    )
    assert other.unit[2] == pytest.approx(first.unit[2], abs=3e-3)
    assert other.unit[2] == pytest.approx(unit[2], abs=0.01)
