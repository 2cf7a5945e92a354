"""Recorded episodes that are not used."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import h5py
import numpy as np
import pytest

from simtune.config import CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.real.recorded import how_many
from simtune.recordings import Dataset, open_dataset
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


def table(rate: int = 10, name: str = "slide") -> str:
    return "\n".join([f"time,{name}", *(f"{row / rate},{row}" for row in range(5))])


@pytest.mark.parametrize(
    "first", [table(rate=5), table(name="lift"), table().replace("0.2,2", "0.2,two")]
)
def test_a_table_that_is_left_out_decides_nothing(tmp_path, first):
    for name, text in (("a", first), ("b", table()), ("c", table())):
        (tmp_path / f"{name}.csv").write_text(text)
    dataset = open_dataset(tmp_path, cameras=(), leave_out=["a"])
    assert dataset.action_names == ("slide",)
    assert dataset.step_s == pytest.approx(0.1)
    for episode in range(2):
        assert dataset.read(episode).actions.ravel().tolist() == [0, 1, 2, 3]
    (tmp_path / "c.csv").write_text(table(name="lift"))
    with pytest.raises(InputError, match=r"expected the columns of b\.csv \(time, slide\), got"):
        dataset.read(1)


@pytest.mark.parametrize("first", [{"hz": 5.0}, {"actions": np.zeros((5, 2))}, {"angle": 0}, None])
def test_arrays_that_are_left_out_decide_nothing(tmp_path, first):
    plain = {"hz": 10.0, "actions": np.ones((4, 1)), "angle": np.zeros((5, 1))}
    for name, changed in (("a", first), ("b", {}), ("c", {})):
        np.savez(tmp_path / f"{name}.npz", **cast(Any, plain | (changed or {})))
    if first is None:
        (tmp_path / "a.npz").write_bytes(b"cut")
    given = {"cameras": (), "leave_out": ["a"], "readings": {"arm": ["angle"]}}
    dataset = open_dataset(tmp_path, **given)
    assert dataset.step_s == pytest.approx(0.1)
    assert [dataset.read(episode).actions.shape for episode in range(2)] == [(4, 1)] * 2
    np.savez(tmp_path / "c.npz", **cast(Any, plain | {"angle": np.zeros((5, 2))}))
    with pytest.raises(InputError, match=r"expected 1 numbers of angle in a row, as in b\.npz"):
        dataset.read(1)


def test_a_demo_that_is_left_out_decides_nothing(tmp_path):
    with h5py.File(tmp_path / "demos.hdf5", "w") as file:
        for demo, width in enumerate((2, 1, 3)):
            file[f"data/demo_{demo}/actions"] = np.zeros((5, width))
            file[f"data/demo_{demo}/obs/angle"] = np.zeros((5, width))
    given = {"cameras": (), "control_hz": 10.0, "readings": {"arm": ["angle"]}}
    dataset = open_dataset(tmp_path, leave_out=["demo_0"], **given)
    assert dataset.read(0).readings["arm"].shape == (5, 1)
    with pytest.raises(InputError, match=r"expected actions \(T, 1\), as in demo_1, got"):
        dataset.read(1)


def test_episodes_are_not_compared_with_each_other():
    """Which took seconds where there are many."""
    compared = []

    class Name(str):
        __hash__ = str.__hash__

        def __eq__(self, other: object) -> bool:
            compared.append(other)
            return super().__eq__(other)

    names = [Name(number) for number in range(100)]
    source = SimpleNamespace(
        path=Path(), episodes=names, kept=range(1, 100), readings=[], fps=10.0, action_names=("a",)
    )
    dataset = Dataset(cast(Any, source))
    assert (dataset.num_episodes, dataset.num_left_out) == (99, 1)
    assert len(compared) < 10 * len(names)
