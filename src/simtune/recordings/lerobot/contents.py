"""Contents of a LeRobotDataset v3.0 that is written, except its frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from simtune.cameras.views import apart
from simtune.recordings.lerobot.layout import STATE
from simtune.recordings.lerobot.stats import count_colours
from simtune.trajectory import Trajectory

# Columns of the table of rows; STATE is missing without readings
COLUMNS = {
    STATE: "float32",
    "action": "float32",
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
CAMERA = "camera0"  # default name of the camera
FIRST = {"chunk_index": 0, "file_index": 0}  # everything goes into the first file of each kind


def first_file(folder: Path, template: str, **names: str) -> Path:
    """Path of the first file for a path template of the layout; its folder is made."""
    path = folder / template.format(**FIRST, **names)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


@dataclass(kw_only=True)
class Contents:
    """The contents, added one episode at a time."""

    step_s: float
    height: int  # pixels, of all pictures; 0: there are none
    widths: Mapping[str, int]  # {camera: pixels}, in the order in which frames show them
    action_names: tuple[str, ...]
    reading_names: Mapping[str, Sequence[str]]  # {sensor: names of its numbers}
    robot_type: str
    task: str
    # {column: rows} of each episode
    columns: list[dict[str, np.ndarray]] = field(default_factory=list)
    # {camera: (3, 256) histogram} of each episode
    colours: list[dict[str, np.ndarray]] = field(default_factory=list)

    @property
    def fps(self) -> float:
        """Rows per second; an int if it is whole, as lerobot expects."""
        fps = 1 / self.step_s
        return round(fps) if abs(fps - round(fps)) < 1e-6 * fps else fps

    def views(self, frames: np.ndarray) -> dict[str, np.ndarray]:
        """{camera: (T, H, W, 3)} from frames (T, H, W₁ + W₂ + …, 3)."""
        return dict(zip(self.widths, apart(frames, list(self.widths.values())), strict=True))

    @property
    def image_size(self) -> tuple[int, int]:
        """(height, width) of all views together, pixels."""
        return self.height, sum(self.widths.values())

    @property
    def names(self) -> dict[str, list[str]]:
        """{column: names of its numbers} for columns of lists."""
        state = [name for names in self.reading_names.values() for name in names]
        return {**({STATE: state} if state else {}), "action": list(self.action_names)}

    @property
    def num_rows(self) -> int:
        return sum(len(columns["index"]) for columns in self.columns)

    def all_rows(self) -> dict[str, np.ndarray]:
        """The columns of all episodes, one after the other."""
        names = self.columns[0]
        return {name: np.concatenate([rows[name] for rows in self.columns]) for name in names}

    def add(self, trajectory: Trajectory) -> None:
        """Add an episode's rows and histograms. Raises ValueError if it does not fit."""
        self._check(trajectory)
        frame_index = np.arange(len(trajectory) + 1)
        columns = {
            **self._state(trajectory),
            "action": np.concatenate([trajectory.actions, trajectory.actions[-1:]]),
            "timestamp": frame_index / self.fps,
            "frame_index": frame_index,
            "episode_index": np.full_like(frame_index, len(self.columns)),
            "index": frame_index + self.num_rows,
            "task_index": np.zeros_like(frame_index),
        }
        self.columns.append({name: found.astype(COLUMNS[name]) for name, found in columns.items()})
        views = self.views(trajectory.frames)
        self.colours.append({name: count_colours(view) for name, view in views.items()})

    def _state(self, trajectory: Trajectory) -> dict[str, np.ndarray]:
        """{STATE: (T + 1, D) readings of all sensors}; empty if no readings are written."""
        if not self.reading_names:
            return {}
        return {STATE: np.hstack([trajectory.readings[name] for name in self.reading_names])}

    def _check(self, trajectory: Trajectory) -> None:
        actions, size = trajectory.actions, trajectory.frames.shape[1:3]
        where, num_actions = f"trajectory {len(self.columns)}", len(self.action_names)
        if len(trajectory) == 0 or actions.shape[1] != num_actions:
            raise ValueError(
                f"{where}: expected actions (T, {num_actions}), T >= 1, got {actions.shape}"
            )
        if not np.isfinite(actions).all():
            raise ValueError(f"{where}: actions are not all finite")
        for sensor, names in self.reading_names.items():
            expected = (len(trajectory) + 1, len(names))
            got = trajectory.readings.get(sensor, np.empty((0, 0))).shape
            if got != expected:
                raise ValueError(f"{where}: expected readings {expected} of {sensor}, got {got}")
        if size != self.image_size or trajectory.step_s != self.step_s:
            raise ValueError(
                f"{where}: expected frames of {self.image_size} pixels every {self.step_s} s as in "
                f"the first one, got {size} every {trajectory.step_s} s"
            )
