"""Names of the LeRobotDataset v3.0 layout, for its reader and its writer."""

from pathlib import Path

CODEBASE_VERSION = "v3.0"
INFO_PATH = "meta/info.json"
STATS_PATH = "meta/stats.json"
TASKS_PATH = "meta/tasks.parquet"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
IMAGES_PREFIX = "observation.images."
DEFAULT_CAMERA = "observation.images.camera0"
FIRST = {"chunk_index": 0, "file_index": 0}  # what is written goes into the first file of its kind


def first_file(folder: Path, template: str, **names: str) -> Path:
    """Where it is to be written, by one of the paths above; its folder is made."""
    path = folder / template.format(**FIRST, **names)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
