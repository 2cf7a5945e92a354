"""What goes into a LeRobotDataset v3.0, but for its frames."""

from dataclasses import dataclass, field

import numpy as np

from simtune.recordings.lerobot_stats import count_colours
from simtune.trajectory import Trajectory


@dataclass(kw_only=True)
class Contents:
    """Gathered an episode at a time."""

    step_s: float
    image_size: tuple[int, int]  # (height, width), pixels
    action_names: tuple[str, ...]
    robot_type: str
    task: str
    camera: str
    columns: list[dict[str, np.ndarray]] = field(default_factory=list)  # an episode's rows
    colours: list[np.ndarray] = field(default_factory=list)  # an episode's histogram (3, 256)

    @property
    def fps(self) -> float:
        """Rows a second; an int where it is whole, as lerobot wants it."""
        fps = 1 / self.step_s
        return round(fps) if abs(fps - round(fps)) < 1e-6 * fps else fps

    @property
    def num_rows(self) -> int:
        return sum(len(columns["index"]) for columns in self.columns)

    def add(self, trajectory: Trajectory) -> None:
        """Note an episode's rows and colours."""
        actions = np.concatenate([trajectory.actions, trajectory.actions[-1:]])
        frame_index = np.arange(len(actions))
        self.colours.append(count_colours(trajectory.frames))
        self.columns.append(
            {
                "action": actions.astype(np.float32),
                "timestamp": (frame_index / self.fps).astype(np.float32),
                "frame_index": frame_index,
                "episode_index": np.full(len(actions), len(self.columns)),
                "index": frame_index + self.num_rows,
                "task_index": np.zeros(len(actions), np.int64),
            }
        )

    def check(self, trajectory: Trajectory) -> None:
        """Raise ValueError where the trajectory does not fit the dataset."""
        episode, num_actions = len(self.columns), trajectory.actions.shape[1]
        if len(trajectory) == 0 or num_actions != len(self.action_names):
            raise ValueError(
                f"trajectory {episode}: expected actions (T, {len(self.action_names)}), T >= 1, "
                f"got {trajectory.actions.shape}"
            )
        if not np.isfinite(trajectory.actions).all():
            raise ValueError(f"trajectory {episode}: actions are not all finite")
        if trajectory.frames.shape[1:3] != self.image_size or trajectory.step_s != self.step_s:
            raise ValueError(
                f"trajectory {episode}: expected frames of {self.image_size} pixels every "
                f"{self.step_s} s as in the first one, got {trajectory.frames.shape[1:3]} every "
                f"{trajectory.step_s} s"
            )
