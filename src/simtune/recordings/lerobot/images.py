"""Pictures that a LeRobotDataset stores one by one, as PNG or JPEG in its tables of rows."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from simtune.errors import InputError
from simtune.recordings.lerobot.episodes import Episode
from simtune.recordings.lerobot.parquet import numbers, open_table, read_table
from simtune.recordings.source import nearest_rows
from simtune.recordings.still import decode_picture

_PICTURES_PER_BATCH = 8  # in memory, undecoded: a row group may hold thousands


def episode_pictures(
    where: Episode, key: str, times_s: np.ndarray, fps: float
) -> Iterator[tuple[float, np.ndarray]]:
    """An episode's pictures nearest to rising times: the time of each, and (H, W, 3) uint8.

    Raises InputError if one is missing or damaged.
    """
    path, name = where.data_file, f"episode {where.index}"
    table = read_table(path, ["episode_index", "frame_index", "timestamp"])
    rows = np.flatnonzero(numbers(table, "episode_index", path) == where.index)
    if (np.diff(numbers(table, "frame_index", path)[rows]) != 1).any():
        raise InputError(
            f"{path}: rows of {name} are not in order, and hold its pictures; sort them by "
            "episode_index and frame_index"
        )
    start_s = numbers(table, "timestamp", path)[rows[0]]
    nearest = nearest_rows(f"{path}: {name}", times_s - start_s, fps, len(rows))
    contents = stored_pictures(path, key, rows[nearest].tolist())
    for row, content in zip(nearest, contents, strict=True):
        try:
            picture = decode_picture(content)
        except InputError as error:
            raise InputError(f"{path}: row {rows[row]}: {error}") from None
        yield float(start_s + row / fps), picture


def first_picture(where: Episode, key: str) -> bytes:
    """The content of an episode's first one. Raises InputError."""
    path = where.data_file
    episodes = numbers(read_table(path, ["episode_index"]), "episode_index", path)
    return next(stored_pictures(path, key, [int(np.argmax(episodes == where.index))]))


def stored_pictures(path: Path, key: str, rows: Sequence[int]) -> Iterator[bytes]:
    """The files' contents in these rows of a table, which rise; a row may come more than once.

    Raises InputError if there is no such column, or no picture in a row.
    """
    with open_table(path, [key]) as file:
        if not _holds_pictures(file.schema_arrow.field(key).type):
            raise InputError(f"{path}: expected pictures in column {key!r}, as bytes and path")
        wanted, first = iter(rows), 0
        row = next(wanted, None)
        for group in range(file.metadata.num_row_groups):
            end = first + file.metadata.row_group(group).num_rows
            if row is None:
                return
            if row >= end:
                first = end
                continue
            # Asked for "a", pyarrow reads "a.b" as well.
            for batch in file.iter_batches(_PICTURES_PER_BATCH, row_groups=[group], columns=[key]):
                column = batch.column(key)
                while row is not None and row < first + len(column):
                    yield _content(path, key, column[row - first].as_py(), row)
                    row = next(wanted, None)
                first += len(column)


def _content(path: Path, key: str, cell: dict[str, object] | None, row: int) -> bytes:
    content = (cell or {}).get("bytes")
    if not isinstance(content, bytes):
        raise InputError(
            f"{path}: row {row} has no bytes of a picture in column {key!r}; expected pictures "
            "within the table, as lerobot stores them"
        )
    return content


def _holds_pictures(kind: pa.DataType) -> bool:
    if not isinstance(kind, pa.StructType) or kind.get_field_index("bytes") < 0:
        return False
    content = kind.field("bytes").type
    return pa.types.is_binary(content) or pa.types.is_large_binary(content)
