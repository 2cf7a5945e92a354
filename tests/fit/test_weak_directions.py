"""Derivatives along combinations of parameters that readings hardly tell."""

from pathlib import Path

import numpy as np
import pytest

from simtune.budget import Budget
from simtune.fit import Guess, OutputErrorMethod, Readings, ReplayStage
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.weak_directions import sharpened
from simtune.real.observed import observed
from simtune.tasks import load_task

STEP_S = 0.02
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="bob"><joint name="swing" axis="0 1 0" damping=".1"/>
    <geom size=".05" pos="0 0 -.3" mass="1" contype="0"/></body></worldbody>
  <actuator><motor name="drive" joint="swing" gear="2"/></actuator>
</mujoco>
"""
TUNE = f"""
model = "scene.xml"
control_timestep_s = {STEP_S}
[[sensors]]
name = "encoder"
joints = ["swing"]
noise = 1e-4
offset = 0
[[parameters]]
name = "mass"
kind = "mass"
objects = "bob"
[[parameters]]
name = "torque"
kind = "gain"
objects = "drive"
"""
DAMPING = '[[parameters]]\nname = "damping"\nkind = "damping"\nobjects = "swing"\n'


def fitted(
    folder: Path, tune: str, scene: str = SCENE
) -> tuple[OutputErrorMethod, Readings, np.ndarray]:
    """A method, readings of the nominal world, and its unit coordinates."""
    (folder / "scene.xml").write_text(scene)
    (folder / "tune.toml").write_text(tune)
    task = load_task(str(folder / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    rng, nominal = np.random.default_rng(0), task.parameters.nominal
    actions = np.repeat(rng.uniform(-1, 1, (3, 25, 1)), 8, 1)
    played = simulator.roll_out(np.tile(nominal, (3, 1)), actions, rng)
    angles = simulator.state_space.positions_and_velocities(played.states)[..., :1]
    readings = Readings(actions, angles + 1e-4 * rng.normal(size=angles.shape))
    loop, unit = set_up_loop(simulator, seen, nominal), task.parameters.to_unit(nominal)
    return OutputErrorMethod(loop, np.zeros(1, bool), unit), readings, unit


def std_of(folder: Path, tune: str, scene: str = SCENE) -> np.ndarray:
    """(P,) what a fit from the truth claims, in unit coordinates."""
    method, readings, unit = fitted(folder, tune, scene)
    segments = method.follow(readings, Guess(unit, np.zeros(1)))
    stage = ReplayStage(4, segments, goes_on=True)
    ended = method.descend(readings, Guess(unit, np.zeros(1)), stage, Budget())
    return np.sqrt(np.diag(method.judge(ended, Budget()).covariance))


def test_a_factor_on_all_masses_and_forces_is_not_told(tmp_path: Path):
    """As it is with one of them known; the first prior is what is left, .3 for each."""
    free = std_of(tmp_path, TUNE + DAMPING)
    np.testing.assert_allclose(free, 0.3 / np.sqrt(3), rtol=0.05)
    assert std_of(tmp_path, TUNE).max() < 0.01


def test_parameters_without_any_effect_take_no_direction_from_others(tmp_path: Path):
    unseen = "".join(
        f'[[parameters]]\nname = "{i}"\nkind = "friction"\nobjects = "{i}"\n' for i in "abc"
    )
    untouched = "".join(f'<geom name="{n}" size=".01" pos="9 0 {i}"/>' for i, n in enumerate("abc"))
    scene = SCENE.replace("<worldbody>", f"<worldbody>{untouched}")
    free = std_of(tmp_path, TUNE + DAMPING + unseen, scene)
    np.testing.assert_allclose(free[:3], 0.3 / np.sqrt(3), rtol=0.05)


def test_slopes_are_those_of_weak_directions_and_else_as_they_were(tmp_path: Path):
    method, readings, unit = fitted(tmp_path, TUNE + DAMPING)
    loop = method._loop
    stretches = loop.cut(readings, unit)
    start_std = loop.measured.start_std(np.full(1, 1e-4), stretches)
    at = DifferencePoint(stretches, stretches.states, unit, start_std)
    slopes = differentiate(loop, at)
    by = slopes.by_parameter  # (W, 3, K + 1, 1)
    information = np.einsum("wpkd,wqkd->pq", by, by)
    sharp = sharpened(loop, at, slopes, information).by_parameter
    together = by.sum(1)  # all three, on alike log scales
    assert np.abs(together).max() > 1e-4 * np.abs(by).max()
    assert np.abs(sharp.sum(1)).max() < 0.05 * np.abs(together).max()
    assert np.abs(sharp - by).max() < 0.01 * np.abs(by).max()
    apart = np.array([1.0, -1.0, 0.0])  # far from weak
    near = np.einsum("p,wpkd->wkd", apart, sharp - by)
    assert np.abs(near).max() < 0.01 * np.abs(np.einsum("p,wpkd->wkd", apart, by)).max()


@pytest.mark.parametrize("at_bound", [0.0, 1.0])
def test_at_a_bound_a_direction_is_taken_inward(tmp_path: Path, at_bound: float):
    method, readings, unit = fitted(tmp_path, TUNE + DAMPING)
    loop, unit = method._loop, np.full(3, at_bound)
    stretches = loop.cut(readings, unit)
    start_std = loop.measured.start_std(np.full(1, 1e-4), stretches)
    at = DifferencePoint(stretches, stretches.states, unit, start_std)
    slopes = differentiate(loop, at)
    by = slopes.by_parameter
    sharp = sharpened(loop, at, slopes, np.einsum("wpkd,wqkd->pq", by, by)).by_parameter
    assert np.abs(sharp.sum(1)).max() < 0.2 * np.abs(by.sum(1)).max()
