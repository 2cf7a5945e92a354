"""Names of the LeRobotDataset layouts, for their readers and for the writer, which writes v3.0."""

import re
import reprlib
from dataclasses import dataclass
from pathlib import Path

from simtune.errors import InputError

CODEBASE_VERSION = "v3.0"
INFO_PATH = "meta/info.json"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
IMAGES_PREFIX = "observation.images."
STATE = "observation.state"


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where a version keeps what. Paths are templates, filled in with numbers and a video's key."""

    major: int
    episodes: str  # where they are listed
    data_path: str
    video_path: str
    # What templates of a dataset may be. No other fields, widths or attributes: they come from
    # someone else.
    template: re.Pattern[str]


# An episode a file.
V2 = Layout(
    major=2,
    episodes="meta/episodes.jsonl",
    data_path="data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    video_path="videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    template=re.compile(
        r"(?=.*\{episode_index)([^{}]|\{video_key\}|\{episode_(chunk|index)(:0?\d?d)?\})+"
    ),
)
# Many episodes share a file.
V3 = Layout(
    major=3,
    episodes="meta/episodes/",
    data_path=DATA_PATH,
    video_path=VIDEO_PATH,
    template=re.compile(r"([^{}]|\{video_key\}|\{(chunk|file)_index(:0?\d?d)?\})+"),
)


def layout_of(version: object) -> Layout | None:
    """Of a dataset that says this `codebase_version`; None: of one that cannot be read."""
    if not isinstance(version, str):
        return None
    if re.fullmatch(r"v2\.[01]", version):
        return V2
    return V3 if re.fullmatch(r"v3(\.\d{1,3})?", version) else None


def unexpected(folder: Path, what: str, got: object) -> InputError:
    """To raise where meta/info.json says something else."""
    return InputError(f"{folder / INFO_PATH}: expected {what}, got {reprlib.repr(got)}")
