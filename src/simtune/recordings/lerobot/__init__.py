"""LeRobotDataset v3.0: many episodes share a parquet file of actions, and a video."""

from simtune.recordings.lerobot.layout import INFO_PATH
from simtune.recordings.lerobot.source import LeRobotSource
from simtune.recordings.lerobot.writer import write_dataset

__all__ = ["INFO_PATH", "LeRobotSource", "write_dataset"]
