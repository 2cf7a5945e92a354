"""Reads CSV files of numbers with a header of names."""

import csv
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings.source import MOST_ACTIONS, MOST_ROWS, Lines, short

_TIMES = ("time", "timestamp", "time_s", "timestamp_s", "t")  # case-insensitive
MEASURED = "measured"  # a reading's column is measured.NAME, case-insensitive


def read_header(path: Path) -> list[str]:
    """Names of the columns. Raises InputError."""
    _, header = next(_lines(path), (0, []))
    if not header:
        raise InputError(f"{path}: is empty; expected a header with the actions' names")
    names = [name.strip() for name in header]
    if len(names) == 1 and re.search(r"[;\t]", names[0]):
        raise InputError(f"{path}: expected commas between columns, got {names[0]!r}")
    if len(names) > MOST_ACTIONS:
        raise InputError(f"{path}: has {len(names)} columns; expected at most {MOST_ACTIONS}")
    if "" in names and any(names):
        raise InputError(
            f"{path}: column {names.index('') + 1} has no name; a comma too many, or an index that "
            "pandas wrote? Write it with to_csv(..., index=False)"
        )
    if any(re.fullmatch(r"[-+.\d]+(e[-+]?\d+)?|nan|", name) for name in names):
        raise InputError(f"{path}: expected a header with the actions' names, got {short(names)}")
    if sum(map(is_time, names)) > 1 or len(set(names)) < len(names):
        raise InputError(
            f"{path}: expected each column once, and one of seconds at most; got {short(names)}"
        )
    return names


def is_time(name: str) -> bool:
    """Whether a column of this name holds seconds."""
    return name.lower() in _TIMES


def is_reading(name: str) -> bool:
    """Whether a column of this name is a reading; columns that are neither time nor reading are
    actions.
    """
    return name.lower().startswith(f"{MEASURED}.")


def read_rows(path: Path, num_columns: int) -> tuple[np.ndarray, np.ndarray, Lines]:
    """(rows, columns) numbers after the header, NaN for empty cells; which cells are empty, (rows,
    columns) bool, as "nan" is not; and line numbers.
    """
    rows: list[np.ndarray] = []
    empty: list[np.ndarray] = []
    lines = Lines(path, numbers := [])
    for number, cells in itertools.islice(_lines(path), 1, None):
        numbers.append(number)
        where = lines.place(-1)
        if len(cells) != num_columns:
            raise InputError(f"{where}: expected {num_columns} cells, got {len(cells)}")
        empty.append(np.array([not cell.strip() for cell in cells]))
        try:
            rows.append(np.array([_number(cell) for cell in cells]))
        except ValueError as error:
            cell = str(error).partition(": ")[2]
            raise InputError(f"{where}: expected a number, got {cell}") from None
        if len(rows) > MOST_ROWS:
            raise InputError(f"{path}: has more than {MOST_ROWS} rows; split the episode")
    if len(rows) < 2:
        raise InputError(f"{path}: has {len(rows)} rows of numbers; expected at least 2")
    return np.stack(rows), np.stack(empty), lines


def _number(cell: str) -> float:
    """A cell's number, NaN for an empty one. Raises ValueError; `float` would take 1_0 for 10."""
    if "_" in cell:
        raise ValueError(f"not a number: {cell!r}")
    return float(cell) if cell.strip() else np.nan


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number (from 1) and the cells of each line, without empty ones at the ends.

    One in between may be a lost row, after which all others would be a step early.
    """
    num_lines, empty = 0, 0
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            for cells in reader:
                if cells and empty:
                    raise InputError(
                        f"{path}: line {empty} is empty, but others follow; expected a row for "
                        "each step: take the line out if none is missing there"
                    )
                if cells:
                    num_lines += 1
                    yield reader.line_num, cells
                elif num_lines and not empty:
                    empty = reader.line_num
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not readable as CSV ({error})") from None
