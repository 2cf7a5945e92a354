"""Names of the LeRobotDataset layouts, for the reader, and for the writer of v3.0."""

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
    """File layout of a version. Paths are templates with numbers and a video's key."""

    episodes: str  # place of the list of episodes
    data_path: str
    video_path: str
    # Templates that a dataset may have. Other fields, widths or attributes are refused, since
    # datasets are untrusted.
    template: re.Pattern[str]


# One file per episode
V2 = Layout(
    episodes="meta/episodes.jsonl",
    data_path="data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    video_path="videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    template=re.compile(
        r"(?=.*\{episode_index)([^{}]|\{video_key\}|\{episode_(chunk|index)(:0?\d?d)?\})+"
    ),
)
# Many episodes share a file
V3 = Layout(
    episodes="meta/episodes/",
    data_path=DATA_PATH,
    video_path=VIDEO_PATH,
    template=re.compile(r"([^{}]|\{video_key\}|\{(chunk|file)_index(:0?\d?d)?\})+"),
)


def layout_of(version: object) -> Layout | None:
    """Layout of a dataset with this `codebase_version`; None: it cannot be read."""
    if not isinstance(version, str):
        return None
    if re.fullmatch(r"v2\.[01]", version):
        return V2
    return V3 if re.fullmatch(r"v3(\.\d{1,3})?", version) else None


def unexpected(folder: Path, what: str, got: object) -> InputError:
    """The error to raise if meta/info.json has an unexpected value."""
    return InputError(f"{folder / INFO_PATH}: expected {what}, got {reprlib.repr(got)}")
