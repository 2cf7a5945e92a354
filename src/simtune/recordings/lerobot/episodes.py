"""Where the episodes of a LeRobotDataset v3.0 lie: meta/episodes read and checked."""

import itertools
import re
import reprlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from simtune.errors import InputError
from simtune.recordings.lerobot.layout import DATA_PATH, VIDEO_PATH, unexpected
from simtune.recordings.lerobot.parquet import read_table
from simtune.recordings.source import MOST_ROWS
from simtune.validate import is_number

# No other fields, widths or attributes: a template comes from someone else.
_TEMPLATE = re.compile(r"([^{}]|\{video_key\}|\{(chunk|file)_index(:0?\d?d)?\})+")


@dataclass(frozen=True, kw_only=True)
class Episode:
    """Where one episode lies."""

    index: int
    num_rows: int
    first_index: int | None  # of its rows among those of the dataset, None: not said
    data_file: Path
    video_file: Path
    from_s: float  # where it starts in its video file, seconds


def read_episodes(folder: Path, info: dict[str, Any], camera: str) -> tuple[Episode, ...]:
    """All episodes, by index. Raises InputError where they cannot be as they are listed."""
    templates = (
        _template(folder, info, "data_path", DATA_PATH),
        _template(folder, info, "video_path", VIDEO_PATH),
    )
    episodes: dict[int, Episode] = {}
    for path, row in _rows(folder, camera):
        episode = _episode(folder, path, row, camera, *templates)
        if episode.index in episodes:
            raise InputError(f"{path}: episode {episode.index} is listed twice")
        episodes[episode.index] = episode
    if not episodes:
        raise InputError(f"{folder}: holds no episode; expected at least one")
    total = info.get("total_episodes", len(episodes))
    if total != len(episodes):
        raise InputError(
            f"{folder}: expected {reprlib.repr(total)} episodes as meta/info.json says, "
            f"meta/episodes/ lists {len(episodes)}; copy the dataset again"
        )
    _check_overlaps(episodes.values(), info["fps"])
    return tuple(episodes[index] for index in sorted(episodes))


def _check_overlaps(episodes: Iterable[Episode], fps: float) -> None:
    """No frame of a video belongs to two episodes."""
    in_order = sorted(episodes, key=lambda episode: (episode.video_file, episode.from_s))
    for before, after in itertools.pairwise(in_order):
        ends_s = before.from_s + (before.num_rows - 0.5) / fps
        if before.video_file == after.video_file and after.from_s < ends_s:
            raise InputError(
                f"{after.video_file}: episode {after.index} starts at {after.from_s:g} s, before "
                f"episode {before.index} ends; the timestamps in meta/episodes are wrong"
            )


def _rows(folder: Path, camera: str) -> Iterator[tuple[Path, dict[str, int | float]]]:
    """The file that lists each episode, and the numbers there."""
    paths = sorted((folder / "meta" / "episodes").rglob("*.parquet"))
    if not paths:
        raise InputError(
            f"{folder}: meta/episodes/ holds no parquet file; expected "
            "meta/episodes/chunk-000/file-000.parquet, copy the dataset again"
        )
    video = f"videos/{camera}"
    columns = ["episode_index", "length", "data/chunk_index", "data/file_index"]
    columns += [f"{video}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
    for path in paths:
        for row in read_table(path, columns, optional=["dataset_from_index"]).to_pylist():
            empty = [column for column in columns if not is_number(row[column])]
            if empty:
                raise InputError(
                    f"{path}: episode {row['episode_index']}: expected a number in "
                    f"{empty[0]!r}, got {reprlib.repr(row[empty[0]])}"
                )
            yield path, row


def _episode(
    folder: Path, path: Path, row: dict[str, Any], camera: str, data_path: str, video_path: str
) -> Episode:
    """Where one episode lies, by its row of the file at `path`."""
    index, num_rows = int(row["episode_index"]), int(row["length"])
    if num_rows < 2:
        raise InputError(
            f"{folder}: episode {index} has {num_rows} row{'s' * (num_rows != 1)}; "
            "expected at least 2, a frame before and a frame after an action"
        )
    from_s = float(row[f"videos/{camera}/from_timestamp"])
    if num_rows > MOST_ROWS or from_s < 0:
        what = f"{num_rows} rows" if num_rows > MOST_ROWS else f"a start at {from_s:g} s"
        raise InputError(
            f"{path}: episode {index} has {what}; expected at most {MOST_ROWS} rows and a start "
            "at 0 s or later: copy the dataset again"
        )

    def place(template: str, part: str) -> Path:
        numbers = {key: int(row[f"{part}/{key}"]) for key in ("chunk_index", "file_index")}
        return _inside(folder, template.format(video_key=camera, **numbers))

    first_index = row.get("dataset_from_index")
    return Episode(
        index=index,
        num_rows=num_rows,
        first_index=int(first_index) if is_number(first_index) else None,
        data_file=place(data_path, "data"),
        video_file=place(video_path, f"videos/{camera}"),
        from_s=from_s,
    )


def _template(folder: Path, info: dict[str, Any], key: str, default: str) -> str:
    """A path template of info.json."""
    template = info.get(key) or default
    if not isinstance(template, str) or not _TEMPLATE.fullmatch(template):
        raise unexpected(folder, f"a {key} like {default!r}", template)
    return template


def _inside(folder: Path, place: str) -> Path:
    """A path within the folder; a dataset must not read what else its user may read.

    Links are followed, wherever they lead: who made them could read their targets, and hubs'
    caches consist of them.
    """
    path = PurePosixPath(place)
    too_long = any(len(part) > 255 for part in path.parts)
    if path.is_absolute() or ".." in path.parts or too_long or not place.isprintable():
        raise InputError(
            f"{folder}: {reprlib.repr(place)} leads out of the dataset; "
            "expected all of its files within its folder"
        )
    return folder / path
