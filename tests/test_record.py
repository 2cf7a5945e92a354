"""`record`: what it films comes back by reading it, and simtune tunes to it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_arm import write_arm

from simtune import record as recording
from simtune.algorithm import train
from simtune.config import RecordConfig, TrainConfig
from simtune.errors import InputError
from simtune.real.recorded import RecordedReal
from simtune.record import _check_written, record
from simtune.recordings import open_dataset
from simtune.tasks import load_task

STEPS = 24
TASK = load_task("cartpole")


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(
        recording, "load_task", lambda n: replace(load_task(n), episode_steps=STEPS)
    )


def asked(out: Path, **changes) -> RecordConfig:
    return replace(RecordConfig(task="cartpole", out=out, episodes=2, image_size=64), **changes)


def read(folder: Path, size: int = 64):
    return RecordedReal(open_dataset(folder, image_size=size, num_actions=1)).collect()


def test_a_recorded_dataset_is_read_back_as_it_was_filmed(tmp_path):
    trajectories = read(record(asked(tmp_path / "dataset")))
    assert [len(trajectory) for trajectory in trajectories] == [STEPS, STEPS]
    assert trajectories[0].step_s == pytest.approx(TASK.step_s)
    assert not np.array_equal(trajectories[0].actions, trajectories[1].actions)
    # The same seed films the same, and the pictures are the simulator's but for compression.
    again = read(record(asked(tmp_path / "again")))
    np.testing.assert_array_equal(again[1].frames, trajectories[1].frames)
    other = read(record(asked(tmp_path / "other", seed=1)))
    assert not np.array_equal(other[0].actions, trajectories[0].actions)
    simulator = TASK.simulator(image_size=64)
    rng = np.random.default_rng(0)
    actions = trajectories[0].actions[None].astype(float)
    rollouts = simulator.roll_out(TASK.parameters.nominal[None], actions, rng)
    drawn = simulator.film(rollouts)[0].astype(float)
    assert np.abs(drawn[-1] - trajectories[0].frames[-1]).mean() < 12  # of 255: the same scene


def test_a_world_has_the_parameters_of_the_file(tmp_path):
    file = tmp_path / "red.json"
    file.write_text(json.dumps({"ground_r": 1.0, "ground_g": 0.0, "ground_b": 0.0}))
    red, plain = (
        read(record(asked(tmp_path / name, parameters=given, episodes=1)))[0].frames[0]
        for name, given in (("red", file), ("plain", None))
    )
    changed = plain.astype(int) - red
    assert changed[..., 1:].mean() > 10  # less green and blue
    assert abs(changed[..., 0].mean()) < 3


@pytest.mark.thorough
def test_a_trained_policy_can_be_filmed(tmp_path, quick):
    run = tmp_path / "run"
    steps = 2 * 16 * STEPS
    settings = {"policy_steps": steps, "real_episodes": 1, "scored_episodes": 1}
    train(TrainConfig(task="cartpole", out=run, method="oracle", **settings), settings=quick)
    asked_for = asked(tmp_path / "dataset", episodes=1, policy=str(run))
    (trajectory,) = read(record(asked_for, settings=quick))
    held = trajectory.actions.reshape(-1, 4)
    assert (np.ptp(held, axis=1) > 0).any()  # random actions are held for four steps
    with pytest.raises(InputError, match="was trained for cartpole, not for walker"):
        record(asked(tmp_path / "walker", task="walker", policy=str(run)), settings=quick)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"episodes": 0}, "--episodes must be at least 1, got 0"),
        ({"image_size": 65}, "--image-size must be an even number from 16 to 1024, got 65"),
        ({"policy": "nowhere"}, "must be random, scripted or a folder .* got nowhere"),
        ({"parameters": Path("nowhere.json")}, r"cannot read nowhere\.json"),
        ({"task": "cartpol"}, "did you mean 'cartpole'"),
    ],
)
def test_wrong_input_is_refused_and_nothing_is_written(changes, message, tmp_path):
    with pytest.raises(InputError, match=message):
        record(asked(tmp_path / "dataset", **changes))
    assert not list(tmp_path.iterdir())


def test_record_refuses_a_folder_that_is_not_empty(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="exists already and is not empty"):
        record(asked(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([{"latency_s": 0.1}], "encoders of .* has a latency_s, and what simtune films is in time"),
        ([{}, {"name": "speeds"}], "two sensors of .* would both be written as 'shoulder'"),
        ([{"columns": ("observation.qpos",)}], "reads all of 'observation.qpos', and simtune"),
    ],
)
def test_what_would_not_be_read_back_is_not_recorded(changes, said, tmp_path):
    task = load_task(str(write_arm(tmp_path)))
    sensors = tuple(replace(task.sensors[0], **change) for change in changes)
    with pytest.raises(InputError, match=said):
        _check_written(replace(task, sensors=sensors))
    _check_written(task)
