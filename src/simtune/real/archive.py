"""Datasets that a run films in the real world, in its folder; `--real` reads them as well.

RUN/filmed/000, 001, ... are a LeRobotDataset v3 each, one per session with the robot. NNN.jsonl
beside them has the times, the requested and the sent target of each step, NNN.json what the
session's episodes mean.
"""

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simtune.cameras.footage import Footage
from simtune.real.meaning import Meaning, check_meaning
from simtune.recordings import Dataset, open_dataset, write_dataset
from simtune.run.files import append_jsonl, write_json
from simtune.trajectory import Trajectory

_NEW_SUFFIX, _OLD_SUFFIX = ".new", ".old"  # of hidden folders while a dataset is replaced


class RecordingArchive:
    """The datasets of a folder, oldest first."""

    def __init__(self, folder: Path, num_actions: int, footage: Footage, meaning: Meaning):
        """Raises InputError if a session's episodes mean something else than `meaning`."""
        self.folder, self._num_actions, self._footage = folder, num_actions, footage
        self._meaning = meaning
        for name, dataset in self._datasets().items():
            check_meaning(dataset, _noted(folder / name), meaning)

    @property
    def num_episodes(self) -> int:
        """Raises InputError if a dataset is damaged or has another number of actions."""
        return sum(self._open(path).num_episodes for path in self._datasets().values())

    def read(self, image_size: int) -> list[Trajectory]:
        """All episodes, with pictures `image_size` pixels high. Raises InputError if damaged."""
        return [
            trajectory
            for folder in self._datasets().values()
            for trajectory in _read(self._open(folder, image_size))
        ]

    def _open(self, folder: Path, image_size: int | None = None) -> Dataset:
        return open_dataset(
            folder,
            cameras=[self._footage],
            num_actions=self._num_actions,
            image_size=image_size,
        )

    def new_session(self, **about: Any) -> "RecordingSession":
        """`about`: keyword arguments of `write_dataset`."""
        self.folder.mkdir(parents=True, exist_ok=True)
        # Skip the number of a session that ended within its first episode: it left no dataset.
        used = [int(path.stem) for path in self.folder.iterdir() if path.stem.isdigit()]
        folder = self.folder / f"{max(used, default=-1) + 1:03d}"
        write_json(_noted(folder), self._meaning)
        return RecordingSession(folder, about, self._footage)

    def _datasets(self) -> dict[str, Path]:
        """{name: folder} of each session, in order; nothing is changed."""
        if not self.folder.is_dir():
            return {}
        found = {_replaced(old).name: _whole(old) for old in self.folder.glob(f".*{_OLD_SUFFIX}")}
        # Other hidden folders are datasets that were being written when the process was killed.
        folders = (path for path in self.folder.iterdir() if not path.name.startswith("."))
        found |= {path.name: path for path in folders if (path / "meta").is_dir()}
        return dict(sorted(found.items()))


class RecordingSession:
    """A dataset that grows by whole episodes; if an episode fails, the earlier ones are kept."""

    def __init__(self, folder: Path, about: Mapping[str, Any], footage: Footage):
        self.folder, self._about, self._footage = folder, about, footage
        self._trajectories: list[Trajectory] = []

    def note(self, step: Mapping[str, Any]) -> None:
        """Append a step of the episode that is being filmed to the .jsonl file."""
        line = {"episode": len(self._trajectories), **step}
        append_jsonl(self.folder.with_suffix(".jsonl"), line)

    def add(self, trajectory: Trajectory) -> None:
        """Write the dataset again, with one more episode."""
        _tidy(self.folder.parent)
        self._trajectories.append(trajectory)
        new, old = (
            self.folder.with_name(f".{self.folder.name}{n}") for n in (_NEW_SUFFIX, _OLD_SUFFIX)
        )
        # It is rewritten as a whole: episodes are few and short, and the robot stands still.
        write_dataset(new, self._trajectories, **self._about)
        if self.folder.exists():
            os.replace(self.folder, old)
        os.replace(new, self.folder)
        shutil.rmtree(old, ignore_errors=True)

    def read(self, image_size: int) -> Sequence[Trajectory]:
        """The episodes as read from the stored videos, resized."""
        return _read(open_dataset(self.folder, cameras=[self._footage], image_size=image_size))


def _noted(dataset: Path) -> Path:
    """The file of what a dataset's episodes mean."""
    return dataset.with_suffix(".json")


def _tidy(folder: Path) -> None:
    """Finish replacing datasets, where the process was killed amid it."""
    for old in folder.glob(f".*{_OLD_SUFFIX}"):
        if not (dataset := _replaced(old)).exists():
            os.replace(_whole(old), dataset)
        shutil.rmtree(old, ignore_errors=True)


def _replaced(old: Path) -> Path:
    """The dataset in whose place `old` was."""
    return old.with_name(old.name.removeprefix(".").removesuffix(_OLD_SUFFIX))


def _whole(old: Path) -> Path:
    """The newest whole copy of a dataset that is not in its place.

    `old` was moved only once the new one was written.
    """
    new = old.with_name(f"{old.name.removesuffix(_OLD_SUFFIX)}{_NEW_SUFFIX}")
    return new if new.exists() else old


def _read(dataset: Dataset) -> list[Trajectory]:
    return [dataset.read(episode) for episode in range(dataset.num_episodes)]
