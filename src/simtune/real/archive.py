"""What a run films in the real world: datasets in its folder, which `--real` reads as well.

RUN/filmed/000, 001, ... are a LeRobotDataset v3 each, one a sitting at the robot; NNN.jsonl beside
them has every step's times, what was asked for and what was sent.
"""

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simtune.footage import Footage
from simtune.recordings import Dataset, open_dataset, write_dataset
from simtune.run.files import append_jsonl
from simtune.trajectory import Trajectory


class RecordingArchive:
    """The datasets of a folder, the latest last."""

    def __init__(self, folder: Path, num_actions: int, footage: Footage):
        self._folder, self._num_actions, self._footage = folder, num_actions, footage

    @property
    def num_episodes(self) -> int:
        """Raises InputError where they are damaged, or of another number of actions."""
        return sum(self._open(path).num_episodes for path in self._datasets())

    def read(self, image_size: int) -> list[Trajectory]:
        """All episodes, pictures `image_size` pixels high. Raises InputError for damaged ones."""
        return [
            trajectory
            for folder in self._datasets()
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
        """`about`: what `write_dataset` wants to know."""
        self._folder.mkdir(parents=True, exist_ok=True)
        # Also past a sitting that ended within its first episode.
        used = [int(path.stem) for path in self._folder.iterdir() if path.stem.isdigit()]
        folder = self._folder / f"{max(used, default=-1) + 1:03d}"
        return RecordingSession(folder, about, self._footage)

    def _datasets(self) -> list[Path]:
        if not self._folder.is_dir():
            return []
        return sorted(path for path in self._folder.iterdir() if (path / "meta").is_dir())


class RecordingSession:
    """A dataset that grows by whole episodes; nothing of it is lost when the next one fails."""

    def __init__(self, folder: Path, about: Mapping[str, Any], footage: Footage):
        self.folder, self._about, self._footage = folder, about, footage
        self._trajectories: list[Trajectory] = []

    def note(self, step: Mapping[str, Any]) -> None:
        """Keep what happened in a step of the episode that is being filmed."""
        line = {"episode": len(self._trajectories), **step}
        append_jsonl(self.folder.with_suffix(".jsonl"), line)

    def add(self, trajectory: Trajectory) -> None:
        """Write the dataset with one episode more."""
        self._trajectories.append(trajectory)
        new, old = (self.folder.with_name(f".{self.folder.name}.{n}") for n in ("new", "old"))
        # Whole again each time: episodes are few and short, and the robot stands still.
        write_dataset(new, self._trajectories, **self._about)
        if self.folder.exists():
            os.replace(self.folder, old)
        os.replace(new, self.folder)
        shutil.rmtree(old, ignore_errors=True)

    def read(self, image_size: int) -> Sequence[Trajectory]:
        """The episodes as they will be read ever after: compressed, and resized."""
        return _read(open_dataset(self.folder, cameras=[self._footage], image_size=image_size))


def _read(dataset: Dataset) -> list[Trajectory]:
    return [dataset.read(episode) for episode in range(dataset.num_episodes)]
