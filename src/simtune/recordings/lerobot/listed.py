"""Reads the list of episodes in meta/: lines of JSON in v2, rows of parquet files in v3."""

import reprlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simtune.errors import InputError
from simtune.recordings.lerobot.json_file import read_objects
from simtune.recordings.lerobot.layout import V2, V3, Layout, unexpected
from simtune.recordings.lerobot.parquet import read_table
from simtune.validate import is_number


@dataclass(frozen=True, kw_only=True)
class Listed:
    """An episode as listed; only checked that numbers are numbers."""

    where: str  # the place that lists it, for messages
    index: int
    num_rows: int
    first_index: int | None = None  # of its first row among the dataset's rows; None: not listed
    from_s: float = 0.0  # its start in the video file, seconds
    # Values for the fields of the paths' templates
    data_numbers: Mapping[str, int]
    video_numbers: Mapping[str, int]


def list_episodes(
    folder: Path, info: dict[str, Any], layout: Layout, camera: str | None
) -> Iterator[Listed]:
    """Yield all episodes in the listed order; without a camera, videos are ignored."""
    return _in_lines(folder, info) if layout is V2 else _in_tables(folder, camera)


def _in_lines(folder: Path, info: dict[str, Any]) -> Iterator[Listed]:
    chunks_size = info.get("chunks_size", 1000)
    if type(chunks_size) is not int or chunks_size < 1:
        raise unexpected(folder, "a whole chunks_size of at least 1", chunks_size)
    for where, row in read_objects(folder / V2.episodes):
        _check_numbers(where, row, ("episode_index", "length"))
        index = int(row["episode_index"])
        numbers = {"episode_chunk": index // chunks_size, "episode_index": index}
        yield Listed(
            where=where,
            index=index,
            num_rows=int(row["length"]),
            data_numbers=numbers,
            video_numbers=numbers,
        )


def _in_tables(folder: Path, camera: str | None) -> Iterator[Listed]:
    paths = sorted((folder / V3.episodes).rglob("*.parquet"))
    if not paths:
        raise InputError(
            f"{folder}: meta/episodes/ holds no parquet file; expected "
            "meta/episodes/chunk-000/file-000.parquet, copy the dataset again"
        )
    video, place = f"videos/{camera}", ("chunk_index", "file_index")
    columns = ["episode_index", "length", *(f"data/{name}" for name in place)]
    if camera is not None:
        columns += [f"{video}/{name}" for name in (*place, "from_timestamp")]
    for path in paths:
        for row in read_table(path, columns, optional=["dataset_from_index"]).to_pylist():
            _check_numbers(f"{path}: episode {row['episode_index']}", row, columns)
            first_index = row.get("dataset_from_index")
            yield Listed(
                where=str(path),
                index=int(row["episode_index"]),
                num_rows=int(row["length"]),
                first_index=int(first_index) if is_number(first_index) else None,
                from_s=float(row.get(f"{video}/from_timestamp", 0.0)),
                data_numbers={key: int(row[f"data/{key}"]) for key in place},
                video_numbers={key: int(row.get(f"{video}/{key}", 0)) for key in place},
            )


def _check_numbers(where: str, row: Mapping[str, Any], names: Sequence[str]) -> None:
    for name in names:
        if not is_number(row.get(name)):
            got = reprlib.repr(row.get(name))
            raise InputError(f"{where}: expected a number in {name!r}, got {got}")
