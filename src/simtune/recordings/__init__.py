"""Recordings of a robot: reads several kinds of datasets, writes LeRobotDataset v3.0 and video."""

from simtune.recordings.dataset import Dataset
from simtune.recordings.episode_arrays import check_episode, in_words
from simtune.recordings.lerobot import write_dataset
from simtune.recordings.open import open_dataset
from simtune.recordings.turning import Turning
from simtune.recordings.video import decode
from simtune.recordings.video_writer import write_video

__all__ = [
    "Dataset",
    "Turning",
    "check_episode",
    "decode",
    "in_words",
    "open_dataset",
    "write_dataset",
    "write_video",
]
