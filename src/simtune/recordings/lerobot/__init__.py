"""LeRobotDataset: v3.0, whose episodes share files, and v2, with one file per episode."""

from simtune.recordings.lerobot.layout import INFO_PATH
from simtune.recordings.lerobot.source import LeRobotSource
from simtune.recordings.lerobot.writer import write_dataset

__all__ = ["INFO_PATH", "LeRobotSource", "write_dataset"]
