"""Opens parquet files, and reads columns of numbers, no more than fit into memory."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from simtune.errors import InputError
from simtune.recordings.source import short

# Of a column: 240 MB. A file's size does not tell: a few kB can encode as many equal values.
_MOST_VALUES = 30_000_000
_BUFFER_BYTES = 1 << 20
_LISTS = (pa.ListType, pa.LargeListType, pa.FixedSizeListType)


def read_table(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> pa.Table:
    """Read columns of numbers or of lists of numbers. Raises InputError if missing or damaged."""
    with open_table(path, columns) as file:
        there = file.schema_arrow.names
        wanted = [*columns, *(column for column in optional if column in there)]
        for column in wanted:
            if not _holds_numbers(file.schema_arrow.field(column).type):
                raise InputError(f"{path}: expected numbers in column {column!r}")
            _check_size(path, file, column)
        # Asked for "a", pyarrow reads "a.b" as well.
        return file.read(wanted).select(wanted)


@contextmanager
def open_table(path: Path, columns: Sequence[str]) -> Iterator[pq.ParquetFile]:
    """A file that has these columns. Raises InputError if it is missing, damaged, or lacks one."""
    if not path.is_file():
        raise InputError(f"{path}: missing, though the dataset's meta files name it")
    try:
        # Buffered: else a column of a row group, such as its pictures, is in memory as a whole.
        with pq.ParquetFile(path, buffer_size=_BUFFER_BYTES, pre_buffer=False) as file:
            there = file.schema_arrow.names
            missing = [column for column in columns if column not in there]
            if missing:
                names = [name for name in there if not name.startswith("stats/")]
                raise InputError(f"{path}: no column {missing[0]!r}; there are: {short(names)}")
            yield file
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = (str(error).splitlines() or ["damaged"])[0].rstrip(". ")
        # The message may quote damaged bytes, which must not reach a terminal.
        reason = "".join(char if char.isprintable() else "?" for char in reason)
        raise InputError(
            f"{path}: not a readable parquet file ({reason}); copy the file again"
        ) from None


def _holds_numbers(kind: pa.DataType) -> bool:
    """Whether the type is a number or a list of numbers."""
    kind = kind.value_type if isinstance(kind, _LISTS) else kind
    numeric = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_null)
    return any(is_one(kind) for is_one in numeric)


def _check_size(path: Path, file: pq.ParquetFile, column: str) -> None:
    """Raise InputError if the column has too many values, before it is read."""
    metadata, schema = file.metadata, file.schema
    count = metadata.num_rows
    for i in range(len(schema)):
        leaf = schema.column(i)
        # A list's leaf is NAME.list.element, and names may contain dots. Other columns are not
        # queried: with a damaged footer, a query may crash the process.
        if leaf.max_repetition_level and f"{leaf.path}.".startswith(f"{column}."):
            groups = map(metadata.row_group, range(metadata.num_row_groups))
            count = max(count, sum(group.column(i).num_values for group in groups))
    if count > _MOST_VALUES:
        raise InputError(
            f"{path}: has {count} values in column {column!r}; "
            f"expected at most {_MOST_VALUES}: split the file, or copy it again"
        )


def numbers(table: pa.Table, column: str, path: Path) -> np.ndarray:
    """A column of numbers, (rows,) float64; a list of one number counts as a number."""
    lengths, flat = lists(table[column])
    if (lengths != 1).any():
        raise InputError(f"{path}: expected one number a row in column {column!r}")
    return flat


def lists(values: pa.ChunkedArray) -> tuple[np.ndarray, np.ndarray]:
    """(rows,) lengths of lists of numbers, and all numbers in one array.

    A plain number counts as a list of one; a missing list has the length -1.
    """
    if not isinstance(values.type, _LISTS):
        return np.ones(len(values), int), _floats(values)
    lengths = pc.list_value_length(values).fill_null(-1)  # type: ignore[attr-defined]
    flat = pc.list_flatten(values)  # type: ignore[attr-defined]
    return lengths.to_numpy(), _floats(flat)


def _floats(values: pa.ChunkedArray) -> np.ndarray:
    """The values as float64; NaN if missing."""
    return values.cast(pa.float64(), safe=False).to_numpy()
