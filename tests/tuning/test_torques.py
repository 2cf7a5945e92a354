"""Torques of joints as readings: how they are declared and read, and what they tell."""

from pathlib import Path

import numpy as np
import pytest
from servo_arm import HEAD, SHOULDER, write_arm

from simtune.config import RecordConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import build_experiment
from simtune.filming import record
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.segments import Segments
from simtune.observation import JointReadings
from simtune.tasks import load_task
from simtune.tuning_run import tune

TORQUES = """[[sensors]]
name = "torques"
joints = ["shoulder", "elbow"]
quantity = "torque"
noise = 0.02

"""
MASSES = """[[parameters]]
name = "lower_mass"
kind = "mass"
objects = "lower"

[[parameters]]
name = "upper_mass"
kind = "mass"
objects = "upper"
"""


def arm(folder: Path, torques: str = TORQUES) -> Path:
    return write_arm(folder, HEAD + torques + SHOULDER + MASSES)


def test_torques_have_units_columns_and_a_first_row_that_nobody_knows(tmp_path: Path):
    _, torques = load_task(str(arm(tmp_path))).sensors
    assert torques.columns == ("shoulder.torque", "elbow.torque")
    assert torques.unit == "N·m"
    assert (torques.is_torque, torques.is_position, torques.is_velocity) == (True, False, False)
    assert not torques.finds_offsets
    read = torques.from_recorded(np.ones((4, 2)), 0.05)
    assert np.isnan(read[0]).all()
    np.testing.assert_array_equal(read[1:], 1)
    amperes = TORQUES.replace("noise = 0.02", "noise = 0.1\ngain = 2.5")
    _, by_current = load_task(str(arm(tmp_path, amperes))).sensors
    np.testing.assert_allclose(by_current.from_recorded(np.ones((2, 2)), 0.05)[1], 2.5)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ('unit = "deg"', "torques are in N·m, of slides in N"),
        ("behind_backlash = true", "motors exert torques before the backlash"),
    ],
)
def test_a_torque_has_no_unit_of_angles_and_no_backlash(line: str, complaint: str, tmp_path: Path):
    with pytest.raises(InputError, match=complaint):
        load_task(str(arm(tmp_path, TORQUES.replace("noise", f"{line}\nnoise"))))


def test_a_torque_without_noise_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="give the noise of a torque"):
        load_task(str(arm(tmp_path, TORQUES.replace("noise = 0.02\n", ""))))


def test_a_joint_that_nothing_drives_has_no_torque(tmp_path: Path):
    tune = arm(tmp_path)
    model = (tmp_path / "arm.xml").read_text()
    servo = '<position name="elbow" joint="elbow" kp="20" kv="1.5" ctrlrange="-1 1"/>'
    assert servo in model
    (tmp_path / "arm.xml").write_text(model.replace(servo, ""))
    with pytest.raises(InputError, match="nothing drives elbow: it has no motor's torque"):
        load_task(str(tune))
    tendon = '<tendon><fixed name="t"><joint joint="elbow" coef="2"/></fixed></tendon>'
    by_tendon = model.replace(servo, '<motor name="elbow" tendon="t"/>').replace(
        "<actuator>", f"{tendon}<actuator>"
    )
    (tmp_path / "arm.xml").write_text(by_tendon)
    assert load_task(str(tune)).sensors[1].is_torque


def test_simulated_torques_are_those_of_the_servos(tmp_path: Path):
    experiment = build_experiment(TuneConfig(task=str(arm(tmp_path)), out=tmp_path / "run"))
    encoders, torques = experiment.context.observation.sensors
    simulator, actions = experiment.simulator, np.full((1, 40, 2), 0.5)
    worlds = simulator.space.nominal[None]
    see = experiment.context.observation.observe_beside()
    played = simulator.roll_out(worlds, actions, np.random.default_rng(0), see)
    at_rest, torque = np.split(played.observed[0, -1], [encoders.size])
    np.testing.assert_allclose(torque, [40, 20] * (0.5 - at_rest), rtol=1e-3)
    assert isinstance(torques.evidence(played.observed[..., 2:]), JointReadings)


def test_no_segment_compares_a_torque_that_an_earlier_action_made(tmp_path: Path):
    experiment = build_experiment(TuneConfig(task=str(arm(tmp_path)), out=tmp_path / "run"))
    seen, real = experiment.context.observation, experiment.recordings
    loop = set_up_loop(experiment.simulator, seen, experiment.context.start)
    readings = Readings.of(real, loop.sensors)
    unit = experiment.space.to_unit(experiment.space.nominal)
    values = loop.cut(readings, unit, segments=Segments.evenly(readings, 20)).values
    assert np.isnan(values[:, 0, 2:]).all()
    assert np.isfinite(values[:, 1:]).all()
    assert np.isfinite(values[:, 0, :2]).all()
    windows = seen.sensors[1].evidence(values[..., 2:] * 0 + 1).of_windows()
    assert np.isnan(windows.values[:, 0]).all()


def test_torques_are_written_to_recordings_and_read_again(tmp_path: Path):
    task = str(arm(tmp_path))
    out = record(RecordConfig(task=task, out=tmp_path / "films", episodes=1))
    config = TuneConfig(task=task, real=str(out), out=tmp_path / "run")
    (read,) = build_experiment(config).recordings
    assert np.isnan(read.readings["torques"][0]).all()
    assert np.isfinite(read.readings["torques"][1:]).all()
    assert np.ptp(read.readings["torques"][1:], axis=0).min() > 1  # N·m


@pytest.mark.thorough
def test_torques_tell_masses_from_gains(tmp_path: Path):
    """All of them scaled together move alike; only a force says how strong they are."""
    found = {}
    for name, torques in (("without", ""), ("with", TORQUES)):
        folder = tmp_path / name
        folder.mkdir()
        config = TuneConfig(task=str(arm(folder, torques)), out=folder / "run", budget_minutes=2)
        parameters = tune(config)["parameters"]
        found[name] = {key: its["high"] / its["low"] for key, its in parameters.items()}
    assert found["with"]["upper_mass"] < 0.5 * (found["without"]["upper_mass"] - 1) + 1
