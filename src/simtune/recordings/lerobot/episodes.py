"""Locations of a LeRobotDataset's episodes, as listed in meta/, with checks."""

import itertools
import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from simtune.errors import InputError
from simtune.recordings.lerobot.layout import Layout, unexpected
from simtune.recordings.lerobot.listed import Listed, list_episodes
from simtune.recordings.source import MOST_ROWS, MOST_UNFILMED


@dataclass(frozen=True, kw_only=True)
class Episode:
    """Location of one episode."""

    index: int
    num_rows: int
    first_index: int | None  # of its first row among the dataset's rows; None: not listed
    data_file: Path
    video_file: Path | None  # None: of no camera, or of one whose pictures are in the data file
    from_s: float  # its start in the video file, seconds
    until_s: float = math.inf  # the next episode's; infinite: the file has no further one


def read_episodes(
    folder: Path, info: dict[str, Any], layout: Layout, camera: str | None
) -> tuple[Episode, ...]:
    """All episodes, sorted by index; `camera`: key of the videos, None: none are needed.

    Raises InputError if the list is inconsistent.
    """
    data_path = _template(folder, info, "data_path", layout)
    video_path = _template(folder, info, "video_path", layout)

    def place(template: str, numbers: Mapping[str, int]) -> Path:
        return _inside(folder, template.format(video_key=camera, **numbers))

    episodes: dict[int, Episode] = {}
    for listed in list_episodes(folder, info, layout, camera):
        if listed.index in episodes:
            raise InputError(f"{listed.where}: episode {listed.index} is listed twice")
        _check(listed)
        episodes[listed.index] = Episode(
            index=listed.index,
            num_rows=listed.num_rows,
            first_index=listed.first_index,
            data_file=place(data_path, listed.data_numbers),
            video_file=place(video_path, listed.video_numbers) if camera else None,
            from_s=listed.from_s,
        )
    if not episodes:
        raise InputError(f"{folder}: holds no episode; expected at least one")
    total = info.get("total_episodes", len(episodes))
    if total != len(episodes):
        raise InputError(
            f"{folder}: expected {reprlib.repr(total)} episodes as meta/info.json says, "
            f"{layout.episodes} lists {len(episodes)}; copy the dataset again"
        )
    if camera:
        _set_ends(episodes, info["fps"])
    return tuple(episodes[index] for index in sorted(episodes))


def _check(listed: Listed) -> None:
    index, num_rows = listed.index, listed.num_rows
    if num_rows > MOST_ROWS or listed.from_s < 0:
        what = f"{num_rows} rows" if num_rows > MOST_ROWS else f"a start at {listed.from_s:g} s"
        raise InputError(
            f"{listed.where}: episode {index} has {what}; expected at most {MOST_ROWS} rows and a "
            "start at 0 s or later: copy the dataset again"
        )


def _set_ends(episodes: dict[int, Episode], fps: float) -> None:
    """Set `until_s`. Raises InputError if frames of a video belong to two episodes.

    A video that was shorter than its rows by a few frames is followed by the next one's all the
    same: these rows have no frame.
    """
    in_order = sorted(episodes.values(), key=lambda its: (str(its.video_file), its.from_s))
    for before, after in itertools.pairwise(in_order):
        if before.video_file != after.video_file:
            continue
        if after.from_s < before.from_s + (before.num_rows - MOST_UNFILMED - 0.5) / fps:
            raise InputError(
                f"{after.video_file}: episode {after.index} starts at {after.from_s:g} s, before "
                f"episode {before.index} ends; the timestamps in meta/episodes are wrong, or the "
                f"{fps:g} fps of meta/info.json"
            )
        episodes[before.index] = replace(before, until_s=after.from_s)


def _template(folder: Path, info: dict[str, Any], key: str, layout: Layout) -> str:
    """A path template of info.json. Raises InputError."""
    default: str = getattr(layout, key)
    template = info.get(key) or default
    if not isinstance(template, str) or not layout.template.fullmatch(template):
        raise unexpected(folder, f"a {key} like {default!r}", template)
    return template


def _inside(folder: Path, place: str) -> Path:
    """A path within the folder: a dataset must not make its user read other files.

    Symbolic links are followed wherever they lead: its author could read the target already, and
    the caches of model hubs consist of links.
    """
    path = PurePosixPath(place)
    too_long = any(len(part) > 255 for part in path.parts)
    if path.is_absolute() or ".." in path.parts or too_long or not place.isprintable():
        raise InputError(
            f"{folder}: {reprlib.repr(place)} leads out of the dataset; "
            "expected all of its files within its folder"
        )
    return folder / path
