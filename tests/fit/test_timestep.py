"""What an estimate owes to the model's timestep: a servo that has none, fitted in steps."""

import mujoco
import numpy as np
import pytest

from simtune.budget import Budget
from simtune.fit import (
    Descent,
    Guess,
    OutputErrorFit,
    OutputErrorMethod,
    Readings,
    ReplayStage,
    timestep_warning,
)
from simtune.fit.readings.differences import differentiate
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.timestep import change_by_timestep
from simtune.parameters import ParameterSpace
from simtune.real.observed import observed
from simtune.simulation import Simulator
from simtune.tasks import load_task

STEPS, STEP_S, NOISE = 100, 0.02, 3e-4
TRUTH = {"damping": 0.8, "armature": 0.02}
SCENE = """
<mujoco>
  <option timestep="{timestep_s}" {option}/>
  <worldbody>
    <body name="arm"><joint name="arm" axis="0 1 0" damping=".8" armature=".02"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".5"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="arm" kp="30"/></actuator>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.02
episode_steps = 100

[[sensors]]
name = "encoder"
joints = "arm"
noise = 0.0003
offset = 0

[[parameters]]
name = "damping"
kind = "damping"
objects = "arm"

[[parameters]]
name = "armature"
kind = "armature"
objects = "arm"
"""


def simulator_of(folder, timestep_s: float, option: str = "", more: str = "") -> Simulator:
    (folder / "scene.xml").write_text(SCENE.format(timestep_s=timestep_s, option=option))
    (folder / "tune.toml").write_text(TUNE + more)
    return load_task(str(folder / "tune.toml")).simulator(image_size=16)


def recorded(seed: int) -> Readings:
    """Of an arm that moves with steps of 20 µs."""
    rng, model = (
        np.random.default_rng(seed),
        mujoco.MjModel.from_xml_string(SCENE.format(timestep_s=2e-5, option="")),
    )
    data, places = mujoco.MjData(model), np.zeros(STEPS + 1)
    actions = np.repeat(rng.uniform(-1, 1, STEPS // 10), 10)
    for t, data.ctrl[:] in enumerate(actions[:, None]):
        mujoco.mj_step(model, data, round(STEP_S / 2e-5))
        places[t + 1] = data.qpos[0]
    read = places + NOISE * rng.normal(size=STEPS + 1)
    return Readings(actions[None, :, None], read[None, :, None])


def method_of(folder, simulator: Simulator, is_simulated: bool = False) -> OutputErrorMethod:
    """With the truth as first guess."""
    task = load_task(str(folder / "tune.toml"))
    seen = observed(task, None, is_simulated=is_simulated)
    loop = set_up_loop(simulator, seen, task.parameters.nominal)
    space = loop.physics.parameters
    return OutputErrorMethod(loop, np.zeros(1, bool), space.to_unit(space.nominal))


def fitted(folder, simulator: Simulator, is_simulated: bool, seed: int = 0) -> OutputErrorFit:
    """From a fit that begins at the truth."""
    method = method_of(folder, simulator, is_simulated)
    guess = Guess(method.prior, np.zeros(1))
    ended = method.descend(recorded(seed), guess, ReplayStage(15), Budget())
    return method.judge(ended, Budget())


def off_by(fit: OutputErrorFit, space: ParameterSpace) -> np.ndarray:
    return fit.unit - space.to_unit(space.from_dict(TRUTH))


@pytest.mark.parametrize("seed", [0, 1])
def test_the_change_without_a_timestep_is_how_far_an_estimate_is_off(tmp_path, seed):
    simulator = simulator_of(tmp_path, 0.004)
    fit = fitted(tmp_path, simulator, is_simulated=False, seed=seed)
    off, std = off_by(fit, simulator.space), np.sqrt(np.diag(fit.covariance))
    assert (np.abs(off) > 3 * std).any()  # sure and wrong
    np.testing.assert_allclose(fit.by_timestep, -off, atol=0.25 * np.abs(off).max())


def test_a_finer_timestep_changes_an_estimate_less(tmp_path):
    coarse, fine = (
        fitted(tmp_path, simulator_of(tmp_path, timestep_s), is_simulated=False)
        for timestep_s in (0.004, 0.0005)
    )
    assert np.abs(fine.by_timestep).max() < 0.2 * np.abs(coarse.by_timestep).max()


def test_what_a_fit_had_not_yet_descended_is_no_change_by_the_timestep(tmp_path):
    """Also where there is time for a single step of each only."""
    simulator = simulator_of(tmp_path, 0.004)
    method, begin = method_of(tmp_path, simulator), {"damping": 1.6, "armature": 0.04}
    guess = Guess(simulator.space.to_unit(simulator.space.from_dict(begin)), np.zeros(1))
    early, ended = (
        method.descend(recorded(0), guess, ReplayStage(iterations), Budget())
        for iterations in (2, 15)
    )

    def changed(descent: Descent, seconds: float = np.inf) -> np.ndarray:
        objective = descent.objective
        slopes = differentiate(objective.loop, objective.difference_point(descent.point))
        return change_by_timestep(descent, slopes, Budget(seconds))

    one, other = changed(early), changed(ended)
    assert np.abs(early.unit - ended.unit).max() > 3 * np.abs(other).max()
    np.testing.assert_allclose(one, other, atol=0.4 * np.abs(other).max())
    hurried = changed(ended, 0.0)
    np.testing.assert_allclose(hurried, other, atol=0.4 * np.abs(other).max())
    assert (hurried != 0).any()


def test_a_simulators_own_readings_have_its_timestep(tmp_path):
    fit = fitted(tmp_path, simulator_of(tmp_path, 0.004), is_simulated=True)
    assert (fit.by_timestep == 0).all()


def test_half_the_timestep_is_observed_at_the_same_times(tmp_path):
    coarse, rng = simulator_of(tmp_path, 0.004), np.random.default_rng(0)
    finer, exact = coarse.finer(), simulator_of(tmp_path, 2e-5)
    assert finer is not None
    assert finer.num_substeps == 2 * coarse.num_substeps
    worlds = coarse.space.nominal[None]
    starts = coarse.begin(worlds, rng).states[:, 0]

    def played(simulator: Simulator) -> np.ndarray:
        return simulator.play(
            worlds,
            lambda t, _: np.ones((1, 1)),
            10,
            rng,
            starts=starts,
            observe=lambda batch: np.hstack([batch.time.reshape(1, 1), batch.qpos]),
            observations_per_step=3,  # of five physics steps
        ).observed[0]

    one, other = played(coarse), played(finer)
    np.testing.assert_allclose(other[:, 0], one[:, 0])
    at_steps = played(exact)[::3, 1]
    error = [np.abs(seen[::3, 1] - at_steps).max() for seen in (one, other)]
    assert error[1] == pytest.approx(error[0] / 2, rel=0.2)  # in proportion to the timestep


def test_controls_that_are_remembered_by_steps_have_no_finer_ones(tmp_path):
    delay = '\n[[parameters]]\nname = "late"\nkind = "delay"\nobjects = "servo"\nhigh = 0.05\n'
    assert simulator_of(tmp_path, 0.004, more=delay).finer() is None


def test_runge_kutta_makes_up_for_nothing(tmp_path):
    simulator = simulator_of(tmp_path, 0.002, option='integrator="RK4"')
    fit = fitted(tmp_path, simulator, is_simulated=False)
    assert np.abs(fit.by_timestep).max() < 1e-3


def test_changes_are_told_largest_first(tmp_path):
    space = simulator_of(tmp_path, 0.004).space
    unit, change = space.to_unit(space.nominal), np.array([0.01, -0.03])
    (warning,) = timestep_warning(space, unit, change, 0.004)
    more, less = (100 * abs(space.from_unit(unit + change) / space.nominal - 1)).tolist()
    assert f"armature {less:.2g} % lower, damping {more:.2g} % higher." in warning
    assert "timestep of 4 ms" in warning
    assert timestep_warning(space, unit, np.zeros(2), 0.004) == []
