"""Recordings that begin while motors that lag are at work, and those that begin at rest."""

from pathlib import Path

import numpy as np
import pytest

from simtune.budget import Budget
from simtune.fit import (
    Guess,
    OpenLoopReplay,
    OutputErrorMethod,
    Readings,
    ReplayStage,
    recorded_loop,
    replay_whole,
)
from simtune.fit.readings import recorded_loop as recorded_loop_
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.segments import Segments
from simtune.real.observed import observed
from simtune.simulation import Simulator
from simtune.tasks import load_task

STEP_S, CUT = 0.02, 37
SCENE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body><joint name="lift" type="slide" axis="0 0 1" damping=".5"/>
    <geom size=".1" mass="1"/></body></worldbody>
  <actuator><motor name="fan" joint="lift" gear="20"/></actuator>
</mujoco>
"""
TUNE = f"""
model = "scene.xml"
control_timestep_s = {STEP_S}
[[sensors]]
name = "height"
joints = ["lift"]
noise = 0.0005
[[parameters]]
name = "thrust"
kind = "gain"
objects = "fan"
[[parameters]]
name = "lag"
kind = "lag"
objects = "fan"
nominal = 0.06
"""


@pytest.mark.parametrize(
    ("thrust", "lag", "nominal"),
    [(0.5, 0.06, 0.06), (1, 0.06, 0.3), (2, 0.06, 0.3), (0.5, 0.02, 0.2), (2, 0.2, 0.02)],
)
def test_a_motor_that_lags_ran_before_if_first_readings_say_so(
    tmp_path: Path, thrust: float, lag: float, nominal: float
):
    """Of the same motion, from rest and cut out of it, whatever gain and lag are to be."""
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "tune.toml").write_text(TUNE.replace("0.06", str(nominal)))
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    times, rng = STEP_S * np.arange(150), np.random.default_rng(0)
    actions = 0.49 / thrust + 0.1 * np.sin([3 * times, 5 * times])[..., None]  # it nearly hovers
    world = np.array([thrust, lag])
    played = simulator.roll_out(np.tile(world, (2, 1)), actions, rng)
    heights = simulator.state_space.positions_and_velocities(played.states)[..., :1]
    heights = heights + 1e-4 * rng.normal(size=heights.shape)
    unit = task.parameters.to_unit(world)
    off = set_up_loop(simulator, seen, task.parameters.nominal)

    def astray(loop: OpenLoopReplay, readings: Readings) -> float:
        return np.abs(replay_whole(loop, readings, unit, np.zeros(1)) - readings.values).max()

    whole, cut = (Readings(actions[:, begin:], heights[:, begin:]) for begin in (0, CUT))
    loop = recorded_loop(simulator, seen, task.parameters.nominal, whole)
    assert loop.physics.simulator is simulator
    loop = recorded_loop(simulator, seen, task.parameters.nominal, cut)
    assert loop.physics.simulator is not simulator
    # Not exactly at its first control, which was another one before
    assert astray(loop, cut) < 0.5 * astray(off, cut)


def test_the_same_moments_are_asked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In a run, by its estimate of the time, its check, its fit and its last replay."""
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    left = {simulator: 1.0}  # and nothing by motors that ran: which then begin so

    def count(its: Simulator, first: object) -> float:
        asked.append(its)
        return left.get(its, 0.0)

    monkeypatch.setattr(recorded_loop_, "_left", count)
    asked, nominal = list[Simulator](), task.parameters.nominal
    actions, heights = np.full((2, 60, 1), 0.5), np.zeros((2, 61, 1))
    heights[:, 3] = np.nan
    for steps in (60, 40):  # what comes later does not matter
        readings = Readings(actions[:, :steps].copy(), heights[:, : steps + 1].copy())
        loop = recorded_loop(simulator, seen, nominal, readings)
        assert loop.physics.simulator.held.unsettled_s > 0
        assert len(asked) == 2
    others = [
        (task.simulator(image_size=16), seen, nominal, heights),
        (simulator, observed(task, None, is_simulated=False), nominal, heights),
        (simulator, seen, 1.1 * nominal, heights),
        (simulator, seen, nominal, heights + 1e-3),
    ]
    for number, (its, model, start, values) in enumerate(others, 2):
        recorded_loop(its, model, start, Readings(actions, values))
        assert len(asked) == 2 * number


@pytest.mark.parametrize("axis", ["1 0 0", "0 0 1"])
def test_moments_that_follow_from_what_acted_before_are_left_out(tmp_path: Path, axis: str):
    """For five lags of .06 s, fifteen steps; of motors that were off, nothing is."""
    (tmp_path / "scene.xml").write_text(SCENE.replace("0 0 1", axis))
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=False)
    nominal, rng = task.parameters.nominal, np.random.default_rng(0)
    actions = 0.5 + 0.1 * np.sin(STEP_S * np.arange(150))[None, :, None]
    states = simulator.roll_out(nominal[None], actions, rng).states
    heights = simulator.state_space.positions_and_velocities(states)[..., :1]
    readings, unit = Readings(actions, heights), task.parameters.to_unit(nominal)
    guess = Guess(unit, np.zeros(1))
    for its, first in ((simulator, 0), (simulator.with_running_motors(), 15)):
        loop = set_up_loop(its, seen, nominal)
        method = OutputErrorMethod(loop, np.zeros(1, bool), unit)
        followed = method.follow(readings, guess)
        assert followed.begin.min() >= first
        assert followed.steps.sum() > 150 - first - 16  # nearly all of the rest
        stage = ReplayStage(1, Segments.evenly(readings, 8))
        ended = method.descend(readings, guess, stage, Budget())
        assert first <= ended.objective.stretches.begin.min() < first + 8
        assert loop.unsettled_rows == first


def test_a_running_motors_delay_brings_its_first_control(tmp_path: Path):
    (tmp_path / "scene.xml").write_text(SCENE)
    delayed = '[[parameters]]\nname = "late"\nkind = "delay"\nobjects = "fan"\nhigh = 0.1\n'
    (tmp_path / "tune.toml").write_text(TUNE + delayed)
    simulator = load_task(str(tmp_path / "tune.toml")).simulator(image_size=16)
    hover, rng = np.full((1, 20, 1), 9.81 / 20), np.random.default_rng(0)
    for its, falls in ((simulator, True), (simulator.with_running_motors(), False)):
        states = its.roll_out(np.array([[1.0, 0.06, 0.03]]), hover, rng).states
        heights = its.state_space.positions_and_velocities(states)[0, :, 0]
        assert np.ptp(heights) > 0.05 if falls else np.ptp(heights) < 1e-6


def test_servos_and_motors_without_a_lag_are_not_asked(tmp_path: Path):
    servo = SCENE.replace("<motor", "<position").replace(" gear", " kp")
    (tmp_path / "scene.xml").write_text(servo)
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    assert not task.simulator(image_size=16).held.motors_lag
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "tune.toml").write_text(TUNE[: TUNE.rindex("[[parameters]]")])
    task = load_task(str(tmp_path / "tune.toml"))
    assert not task.simulator(image_size=16).held.motors_lag
