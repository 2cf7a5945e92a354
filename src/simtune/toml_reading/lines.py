"""Line numbers of a TOML file's keys, which Python's parser does not give.

Each statement of a TOML file (a table's header, or a key with its value) is itself a valid TOML
file. So lines are collected until they parse, and the result tells which key they hold.
"""

import tomllib
from typing import Any

KeyPath = tuple[str | int, ...]  # ("parameters", 2, "name"): name in the third [[parameters]]


def key_lines(text: str) -> dict[KeyPath, int]:
    """{path: line, from 1} of all tables and keys of a valid file."""
    lines: dict[KeyPath, int] = {}
    table: KeyPath = ()
    collected, begun = "", 1
    for number, line in enumerate(text.split("\n"), 1):
        collected += line + "\n"
        try:
            statement = tomllib.loads(collected)
        except tomllib.TOMLDecodeError:
            continue  # an array or a string continues on the next line
        if collected.lstrip().startswith("["):
            table = _header(statement, lines)
            lines.setdefault(table, begun)
        else:
            _note(statement, table, begun, lines)
        collected, begun = "", number + 1
    return lines


def line_of(path: KeyPath, lines: dict[KeyPath, int]) -> int:
    """Line of a key, or of an array's first table, or else of the nearest around it, or else 1."""
    while path and path not in lines and (*path, 0) not in lines:
        path = path[:-1]
    return lines.get(path) or lines.get((*path, 0), 1)


def _header(statement: dict[str, Any], known: dict[KeyPath, int]) -> KeyPath:
    """Path of the table that a header begins; [[...]] begins the array's next table."""
    path: KeyPath = ()
    value: Any = statement
    while value:
        if isinstance(value, list):
            return (*path, _count(path, known))
        ((name, value),) = value.items()
        path = (*path, name)
        if value and isinstance(value, dict) and (count := _count(path, known)):
            path = (*path, count - 1)
    return path


def _count(path: KeyPath, known: dict[KeyPath, int]) -> int:
    """Number of tables that the array at `path` has so far."""
    count = 0
    while (*path, count) in known:
        count += 1
    return count


def _note(value: Any, path: KeyPath, line: int, lines: dict[KeyPath, int]) -> None:
    """Record `line`, the statement's first, for all keys within the statement."""
    if path:
        lines.setdefault(path, line)
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        lines.setdefault((*path, key), line)
        if isinstance(inner, dict | list):
            _note(inner, (*path, key), line, lines)
