"""Encoders of the built-in tasks: read where --observe names them, in `tune` and in `train`."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from short_training import config_of

from simtune.algorithm import train
from simtune.budget import Budget
from simtune.config import RecordConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.experiment import build_experiment
from simtune.filming import record
from simtune.observation import AllEvidence, JointReadings, ObservationModel
from simtune.real.choose import choose_real
from simtune.real.observed import observed
from simtune.run.folder import RunFolder
from simtune.run.real_episodes import read_real, write_real
from simtune.tasks import TASKS, load_task
from simtune.trajectory import Trajectory
from simtune.tuning.observing import _scaled_as, _with_inflated_noise
from simtune.tuning.readings import first as readings_first
from simtune.tuning.readings.estimate import search_of
from simtune.tuning.readings.first import ReadingsFirst

WITH_ENCODERS = [name for name in TASKS if load_task(name).sensors]
BOTH = "cameras,joints"


def looked_at(name: str, names: tuple[str, ...] | None = None) -> ObservationModel:
    return observed(load_task(name), names, is_simulated=True)


@pytest.mark.parametrize("name", WITH_ENCODERS)
def test_driven_joints_are_read_where_they_are_asked_for(name: str):
    assert looked_at(name).sensors == ()
    assert len(looked_at(name).cameras) == 1
    seen = looked_at(name, ("cameras", "joints"))
    model = load_task(name).load_model()
    driven = [model.joint(int(j)).name for j in model.actuator_trnid[:, 0]]
    assert set(seen.reading_labels) == set(driven)


def test_encoders_are_of_all_tasks_whose_actuators_drive_joints():
    """The others move their hands by mocap bodies."""
    driving = [name for name in TASKS if load_task(name).load_model().nu]
    assert driving == WITH_ENCODERS, "give suite_task the encoders of the others"


@pytest.mark.parametrize(
    "gap", [False, pytest.param(True, marks=[pytest.mark.thorough, pytest.mark.opengl])]
)
def test_readings_are_where_the_cart_goes_and_encoders_noise(tmp_path: Path, gap: bool):
    config = config_of(tmp_path, observe=BOTH, real_gap=gap)
    task = dataclasses.replace(load_task("cartpole"), episode_steps=80)
    real, _, _ = choose_real(config, task, 32)
    explored = real.collect(1)[0].readings["encoders"]
    pushed = real.run_policy(lambda frames: np.ones((len(frames), 1)), 3, 1, seed=0)[0]
    read = pushed.readings["encoders"]
    assert explored.shape == read.shape == (task.episode_steps + 1, 1)
    # It begins within .1 m of the middle, is pushed to one side and held up at the rail's end
    assert abs(explored[0, 0]) < 0.105
    assert read[20, 0] - read[0, 0] > 0.2
    assert np.diff(read[-40:, 0], 2).std() == pytest.approx(0.001 * 6**0.5, rel=0.4)


def test_what_was_filmed_is_kept_with_its_readings(tmp_path: Path):
    real, _, _ = choose_real(config_of(tmp_path, observe=BOTH), load_task("cartpole"), 32)
    filmed = real.collect(2)
    with RunFolder.create(tmp_path / "run", {}) as run:
        write_real(run.path, 0, filmed)
        again = read_real(run.path, 0, real.step_s)
    for one, other in zip(filmed, again, strict=True):
        np.testing.assert_array_equal(one.frames, other.frames)
        np.testing.assert_array_equal(one.readings["encoders"], other.readings["encoders"])


def test_what_is_recorded_has_readings_and_is_read_with_them(tmp_path: Path):
    record(RecordConfig(task="cartpole", out=tmp_path / "some", episodes=1, image_size=32))
    config = TuneConfig(
        task="cartpole", real=str(tmp_path / "some"), out=tmp_path / "run", observe=BOTH
    )
    (trajectory,) = build_experiment(config).recordings
    assert trajectory.readings["encoders"].shape == (len(trajectory) + 1, 1)


def test_readings_alone_have_no_say_where_a_joint_begins_anywhere(tmp_path: Path):
    """The spinner's angle is the camera's to tell, so whole episodes cannot be replayed."""
    config = TuneConfig(task="finger", out=tmp_path / "run", observe=BOTH, real_episodes=1)
    experiment = build_experiment(config)
    assert search_of(experiment.context, experiment.recordings) is None


def test_readings_are_those_of_the_first_episodes_after_a_resumption_too(tmp_path, monkeypatch):
    """A policy's episodes come later, and first in the list."""
    config = TuneConfig(task="cartpole", out=tmp_path / "run", observe=BOTH, real_episodes=2)
    experiment, read = build_experiment(config), list[list[Trajectory]]()
    monkeypatch.setattr(readings_first, "search_of", lambda context, real: read.append(real))
    real, budget = experiment.recordings, Budget()
    readings, resumed = (ReadingsFirst(experiment.context) for _ in range(2))
    readings.fit(real, 0.0, budget)
    resumed.load(json.loads(json.dumps(readings.state())))
    for one in (readings, resumed):
        one.fit([real[1], real[0], *real], 0.0, budget)
    assert [[id(trajectory) for trajectory in each] for each in read] == [[*map(id, real)]] * 3


def test_readings_in_windows_count_as_thirty_times_as_noisy():
    values = np.zeros((1, 4, 2))
    evidence = AllEvidence((JointReadings.of("encoders", "rad", values, 0.001),))
    off = evidence.log_likelihood(values + 0.02)
    assert _with_inflated_noise(evidence).log_likelihood(values + 0.6) == pytest.approx(off)


def test_a_network_gets_readings_on_the_scale_that_it_learnt():
    """A joint that swings half as far must not look as if it swung as far."""
    swing = np.sin(np.arange(40.0))[None, :, None]
    learnt, real = (
        AllEvidence((JointReadings.of("encoders", "rad", values, 0.001),))
        for values in (swing, 0.5 * swing + 0.1)
    )
    middle, spread = swing.mean(), swing.std()
    expected = (0.5 * swing + 0.1 - middle) / spread
    np.testing.assert_allclose(_scaled_as(real, learnt.at(np.arange(0))).features, expected)


@pytest.mark.thorough
def test_a_policy_is_trained_beside_readings(tmp_path: Path, quickly):
    config = config_of(tmp_path / "run", rounds=1, observe=BOTH)
    with quickly() as quick:
        result = train(config, settings=quick)
    assert set(result["sensors"]) == {"slider"}
    assert (tmp_path / "run" / "replay.json").is_file()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"observe": "joints"}, "a policy acts on pictures: have --observe name cameras too"),
        ({"observe": "encoder"}, "no sensor 'encoder' .* did you mean 'encoders'"),
        ({"observe": BOTH, "method": "dr"}, "--observe goes with --method autotune or regr"),
    ],
)
def test_what_a_policy_cannot_observe_is_refused(tmp_path: Path, changes: dict, said: str):
    with pytest.raises(InputError, match=said):
        train(config_of(tmp_path / "run", **changes))
    assert not (tmp_path / "run").exists()
