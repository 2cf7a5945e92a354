"""Recorded episodes that are not used."""

from pathlib import Path

import numpy as np
import pytest

from simtune.config import CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.real.recorded import how_many
from simtune.recordings import open_dataset
from simtune.recordings.lerobot import write_dataset
from simtune.trajectory import Trajectory


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three episodes, of 4, 2 and 3 steps; each has its number as its action and its picture."""
    folder = tmp_path_factory.mktemp("recorded") / "dataset"
    episodes = [
        Trajectory(
            np.full((steps + 1, 32, 32, 3), 80 * number, np.uint8),
            np.full((steps, 1), number, np.float32),
            0.1,
        )
        for number, steps in enumerate((4, 2, 3))
    ]
    write_dataset(folder, episodes, action_names=["slide"], robot_type="arm", task="swing")
    return folder


def test_what_is_left_out_is_not_read_and_the_others_keep_their_names(folder):
    dataset = open_dataset(folder, leave_out=["1"])
    read = [dataset.read(episode) for episode in range(dataset.num_episodes)]
    assert dataset.episodes == ["episode 0", "episode 2"]
    assert [trajectory.actions.max() for trajectory in read] == [0, 2]
    assert [len(trajectory) for trajectory in read] == [4, 3]
    assert abs(read[1].frames.astype(float) - 160).max() < 8  # its own pictures, through mp4
    facts = dataset.facts(2)
    assert facts["names"] == ["episode 0", "episode 2"]
    assert (facts["episodes_in_dataset"], facts["left_out"]) == (3, 1)
    assert facts["names_left_out"] == ["episode 1"]


@pytest.mark.parametrize(
    ("left_out", "message"),
    [
        (["4"], "no episode '4' in .*, as --leave-out has it; there are: 0, 1, 2"),
        (["0", "episode 1", "2"], "no episode remains of 3: leave out fewer"),
    ],
)
def test_what_cannot_be_left_out_is_refused(folder, left_out, message):
    with pytest.raises(InputError, match=message):
        open_dataset(folder, leave_out=left_out)


def test_no_more_episodes_are_read_than_remain(folder):
    dataset = open_dataset(folder, leave_out=["1"])
    with pytest.raises(InputError, match="3 episodes asked for, it holds 2 besides those left out"):
        how_many(dataset, 3)


def test_leaving_out_goes_with_recordings():
    assert CheckConfig(task="cartpole", leave_out="3, demo_4").left_out == ("3", "demo_4")
    with pytest.raises(InputError, match="--leave-out goes with recordings only"):
        TuneConfig(task="cartpole", out=Path("out"), leave_out="3").check()
