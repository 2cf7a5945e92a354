"""Commands of servos on endless joints, which begin again after each turn."""

import numpy as np
import pytest

from simtune.api.arrays import write_arrays
from simtune.config import TuneConfig
from simtune.errors import InputError
from simtune.real.observed import observed, open_recordings
from simtune.real.recorded import read_episode
from simtune.real.turnings import turnings_of
from simtune.recordings import open_dataset
from simtune.recordings.turning import Turning, commands_counted_on

SCENE = """
<mujoco><worldbody><body><joint name="wheel" axis="0 -1 0" damping="1"/>
  <geom size=".01" pos=".5 0 0" mass="1"/></body></worldbody>
  <actuator><position name="turn" joint="wheel" kp="50" gear="2"/></actuator></mujoco>"""
TUNING = """
model = "scene.xml"
control_timestep_s = 0.02
actions = {mapping = "scaled", gain = 0.034906585, offset = 0.5}
[[sensors]]
name = "encoder"
joints = "wheel"
unit = "deg"
offset = 20.0
[[parameters]]
name = "damping"
kind = "damping"
objects = "wheel"
"""  # an action is degrees of the wheel, less .25 rad: its gear is 2


def wrapped(degrees: np.ndarray) -> np.ndarray:
    return (degrees + 180) % 360 - 180


@pytest.mark.parametrize("turns", [0, 2])
def test_commands_go_with_the_readings_that_are_counted_on(folder, load, turns):
    true = 150.0 + np.linspace(0, 400, 41)
    actions = (wrapped(true + 8) - np.rad2deg(0.25))[:, None]
    episode = {"actions": actions, "hz": 50, "wheel": wrapped(true + 20) + 360 * turns}
    where = write_arrays([episode], folder / "real")
    task = load(TUNING)
    seen = observed(task, None, is_simulated=False)
    config = TuneConfig(task=task.source, out=folder / "run", real=str(where))
    dataset = open_recordings(where, task, config, None, seen)
    read = read_episode(dataset, 0, seen)
    begun = read.readings["encoder"][:, 0]
    targets = np.deg2rad(read.actions[:, 0]) + 0.25
    np.testing.assert_allclose(targets - begun[:-1], np.deg2rad(8), atol=1e-4)
    np.testing.assert_array_equal(dataset.skim(0)[0], read.actions)  # what check sees


def test_commands_that_a_servo_followed_stay_as_they_are():
    """Steps of more than half a turn, as the readings show; and those that count on."""
    sent = np.repeat([0.0, 340.0, 10.0], 20)[:, None]
    followed = np.zeros_like(sent)
    for row, command in enumerate(sent[:-1]):
        followed[row + 1] = followed[row] + 0.4 * (command - followed[row])
    with_readings, without = Turning(0, 360.0, 0), Turning(0, 360.0)
    np.testing.assert_array_equal(commands_counted_on(sent, followed, [with_readings]), sent)
    many = np.linspace(0, 3600, 60)[:, None]
    np.testing.assert_array_equal(commands_counted_on(many, many - 200, [with_readings]), many)
    odd = np.rad2deg(followed)  # in another unit
    np.testing.assert_array_equal(commands_counted_on(sent, odd, [with_readings]), sent)
    rng = np.random.default_rng(0)
    random = rng.uniform(-180, 180, (60, 1))
    np.testing.assert_array_equal(commands_counted_on(random, followed[:, :0], [without]), random)


def test_commands_stay_within_what_their_servo_takes(folder, load):
    """Counted on, they would stop it at the end of its range, in controls of twice the angle."""
    ends = np.deg2rad([-330.0, 430.0])  # of the wheel
    limited = f'<position ctrlrange="{2 * ends[0]} {2 * ends[1]}" '
    (folder / "scene.xml").write_text(SCENE.replace("<position ", limited))
    task = load(TUNING)
    model = task.load_model()
    (turning,) = turnings_of(model, task.map_actions(model), ())
    np.testing.assert_allclose(np.deg2rad([turning.low, turning.high]) + 0.25, ends, atol=1e-6)
    for last, is_within in ((turning.high - 1, True), (turning.high + 1, False)):
        true = np.linspace(100, last, 60)[:, None]
        counted = commands_counted_on(wrapped(true), np.empty((60, 0)), [turning])
        np.testing.assert_allclose(counted, true if is_within else wrapped(true))


def test_without_readings_commands_are_counted_on_in_time():
    true = np.linspace(100, 700, 60)[:, None]
    counted = commands_counted_on(wrapped(true), np.empty((60, 0)), [Turning(0, 360.0)])
    np.testing.assert_allclose(counted, true)
    np.testing.assert_array_equal(commands_counted_on(wrapped(true), true, []), wrapped(true))


def test_fewer_numbers_than_joints_are_refused_by_name(tmp_path):
    """Of two joints, the second of which is endless."""
    np.savez(tmp_path / "turns.npz", hz=50, actions=np.zeros((9, 1)), wheel=np.zeros(9))
    turnings, asked = [Turning(0, 360.0, 1)], {"encoder": ["wheel"]}
    dataset = open_dataset(tmp_path, cameras=(), readings=asked, turnings=turnings)
    with pytest.raises(InputError, match="wheel holds 1 numbers, sensor encoder has 2 joints"):
        dataset.read(0, {"encoder": np.array([np.inf, 360.0])})
    with pytest.raises(InputError, match="wheel: 1 number, fewer than the sensors have joints"):
        dataset.skim(0)
