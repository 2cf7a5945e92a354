"""Names of the LeRobotDataset v3.0 layout, for its reader and its writer."""

import reprlib
from pathlib import Path

from simtune.errors import InputError

CODEBASE_VERSION = "v3.0"
INFO_PATH = "meta/info.json"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
IMAGES_PREFIX = "observation.images."


def unexpected(folder: Path, what: str, got: object) -> InputError:
    """To raise where meta/info.json says something else."""
    return InputError(f"{folder / INFO_PATH}: expected {what}, got {reprlib.repr(got)}")
