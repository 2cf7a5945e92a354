"""A robot's recordings survive whatever ends the process."""

import os
from pathlib import Path

import numpy as np
import pytest

from simtune.cameras.footage import Footage
from simtune.real.archive import RecordingArchive
from simtune.trajectory import Trajectory

ABOUT = {"action_names": ["turn"], "robot_type": "none", "task": "none"}


def an_episode() -> Trajectory:
    return Trajectory(np.zeros((13, 32, 32, 3), np.uint8), np.ones((12, 1), np.float32), 0.1)


@pytest.mark.parametrize(("killed_at", "kept"), [(1, 1), (2, 2)])
def test_a_process_killed_between_two_renames_loses_no_episode(
    killed_at, kept, tmp_path, monkeypatch
):
    archive = RecordingArchive(tmp_path, 1, Footage(name="front", camera="front"), {})
    session = archive.new_session(**ABOUT)
    session.add(an_episode())
    replaced, replace = [], os.replace

    def die(source, to):
        if Path(to).name in ("000", ".000.old"):  # neither is a file within the dataset
            if len(replaced) == killed_at - 1:
                raise KeyboardInterrupt
            replaced.append(source)
        replace(source, to)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", die)
        with pytest.raises(KeyboardInterrupt):
            session.add(an_episode())
    left = sorted(path.name for path in tmp_path.iterdir())
    assert archive.num_episodes == kept
    assert len(archive.read(32)) == kept
    RecordingArchive(tmp_path, 1, Footage(name="front", camera="front"), {})
    assert sorted(path.name for path in tmp_path.iterdir()) == left  # as a dry run leaves it
    archive.new_session(**ABOUT).add(an_episode())
    assert archive.num_episodes == kept + 1
    assert not list(tmp_path.glob(".*.old"))
