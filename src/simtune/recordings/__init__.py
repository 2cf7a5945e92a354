"""Recordings of a robot: LeRobotDataset v3.0 and video files, in and out."""

from simtune.recordings.lerobot_meta import DatasetMeta, Episode, dataset_hash, read_meta
from simtune.recordings.lerobot_reader import Recording, read_dataset
from simtune.recordings.lerobot_writer import write_dataset
from simtune.recordings.video import VideoWriter, decode, frames_at, probe, resize, write_video

__all__ = [
    "DatasetMeta",
    "Episode",
    "Recording",
    "VideoWriter",
    "dataset_hash",
    "decode",
    "frames_at",
    "probe",
    "read_dataset",
    "read_meta",
    "resize",
    "write_dataset",
    "write_video",
]
