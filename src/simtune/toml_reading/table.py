"""Reads TOML files; errors name the line and valid names.

A dict with a file's keys is read in the same way.
"""

import difflib
import json
import math
import re
import tomllib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from simtune.errors import InputError, UnknownName
from simtune.toml_reading.lines import KeyPath, key_lines, line_of
from simtune.toml_reading.values import (
    MOST,
    are_names,
    are_numbers,
    are_tables,
    for_numpy,
    is_array,
    is_pair,
    shown,
)
from simtune.validate import is_number

_REQUIRED: Any = object()
_HINT = " (numbers begin with a digit, as 0.1; texts are in quotes)"


def usual_name(path: Path) -> str:
    """Default name of a task: of its file or, if that is tune.toml, of the folder."""
    return path.resolve().parent.name if path.stem == "tune" else path.stem


def read_toml(file: Path) -> "TomlTable":
    """Read a file. Raises InputError if it cannot be read or is not TOML."""
    try:
        text = file.read_text(encoding="utf-8-sig")  # some editors write a byte order mark
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{file} is no text in UTF-8, so no TOML") from None
    try:
        return TomlTable(tomllib.loads(text), file, key_lines(text))
    except tomllib.TOMLDecodeError as error:
        # The message ends in the position where the parser stopped.
        what, _, at = str(error).removesuffix(")").rpartition(" (at ")
        number = re.match(r"line (\d+)", at)
        line = int(number[1]) if number else text.rstrip().count("\n") + 1
        hint = _HINT if what == "Invalid value" else ""
        its = text.splitlines()[line - 1].strip() if line <= len(text.splitlines()) else ""
        raise InputError(f"{file}:{line}: not valid TOML: {what}: {its}{hint}") from None


class LocatedError(InputError):
    """An error whose message starts with file and line."""


class TomlTable:
    """A table of a TOML file. Methods raise InputError "FILE:LINE: what is wrong".

    For a dict in Python, which has no `lines`, the message is "task['parameters'][0]: ...".
    A key read without a default is required.
    """

    def __init__(
        self,
        values: dict[str, Any],
        file: Path,
        lines: dict[KeyPath, int] | None = None,
        path: KeyPath = (),
    ):
        self._values, self.file, self._lines, self._path = values, file, lines, path

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def content(self, without: str = "") -> str:
        """The table's content as JSON, without comments and without the key `without`."""
        values = {key: value for key, value in self._values.items() if key != without}
        return json.dumps(values, sort_keys=True, default=str)

    @property
    def name(self) -> str:
        """The table's name in messages."""
        names = ".".join(part for part in self._path if isinstance(part, str))
        if not names:
            return "the file"
        return f"[[{names}]]" if isinstance(self._path[-1], int) else f"[{names}]"

    def where(self, key: str | None = None) -> str:
        """FILE:LINE of a key, or of the table."""
        path = self._path if key is None else (*self._path, key)
        if self._lines is None:
            return "".join(["task", *(f"[{part!r}]" for part in path)])
        return f"{self.file}:{line_of(path, self._lines)}"

    def error(self, message: object, key: str | None = None) -> LocatedError:
        """The error to raise for a key or, without one, for the table."""
        return LocatedError(f"{self.where(key)}: {message}")

    @contextmanager
    def at(self, key: str | None = None) -> Iterator[None]:
        """Prefix InputErrors raised within with the key's place, unless they have one."""
        try:
            yield
        except LocatedError:
            raise
        except InputError as error:
            raise self.error(error, key) from None

    def allow(self, *keys: str) -> None:
        """Raise an error if the table has other keys."""
        for key in self._values:
            if key not in keys:
                raise self.error(UnknownName("key", key, self.name, keys), key)

    def value(self, key: str) -> Any:
        """The unchecked value of a key."""
        return self._values[key]

    def text(self, key: str, default: Any = _REQUIRED) -> Any:
        return self._checked(key, "a text", default, lambda v: isinstance(v, str) and v != "")

    def choice(self, key: str, options: Collection[str], default: Any = _REQUIRED) -> Any:
        """A text that must be one of `options`."""
        value = self.text(key, default)
        if key in self and value not in options:
            raise self.error(UnknownName(key, value, self.name, options), key)
        return value

    def flag(self, key: str, default: bool) -> bool:
        return self._checked(key, "true or false", default, lambda v: isinstance(v, bool))

    def number(
        self,
        key: str,
        default: Any = _REQUIRED,
        *,
        above: float = -math.inf,
        below: float = math.inf,
        least: float = -math.inf,
        most: float = math.inf,
    ) -> Any:
        bounds = {"above": above, "below": below, "of at least": least, "at most": most}
        named = [f"{word} {bound:g}" for word, bound in bounds.items() if math.isfinite(bound)]
        return self._checked(
            key,
            " ".join(["a finite number", " and ".join(named)]).strip(),
            default,
            lambda v: is_number(v) and above < v < below and least <= v <= most,
        )

    def whole(self, key: str, default: Any = _REQUIRED, *, least: int = 1, most: int = MOST) -> Any:
        what = f"a whole number of at least {least}"
        what += f" and at most {most}" * (most < MOST)
        return self._checked(
            key, what, default, lambda v: is_number(v) and isinstance(v, int) and least <= v <= most
        )

    def names(self, key: str, default: Any = _REQUIRED) -> Any:
        """A tuple of one or more texts; a single one needs no brackets in the file."""
        value = self._checked(key, "a name or a list of names", default, are_names)
        return (value,) if isinstance(value, str) else value and tuple(value)

    def numbers(self, key: str, count: int, default: Any = _REQUIRED) -> Any:
        """A tuple of `count` numbers."""
        return self._checked(
            key, f"{count} finite numbers", default, lambda v: are_numbers(v, count)
        )

    def pair(self, key: str) -> tuple[float, float]:
        """Low and high end of a range."""
        value = self._checked(key, "two numbers, the lower one first", _REQUIRED, is_pair)
        return value[0], value[1]

    def pairs(self, key: str, count: int) -> list[tuple[float, float]]:
        value = self._checked(
            key,
            f"{count} pairs, the lower number first",
            _REQUIRED,
            lambda v: isinstance(v, list) and len(v) == count and all(map(is_pair, v)),
        )
        return [(low, high) for low, high in value]

    def array(self, key: str, default: Any = _REQUIRED) -> Any:
        """A number or a nested list of numbers; the caller checks its shape."""
        return self._checked(key, "a number or a list of numbers", default, is_array)

    @property
    def is_empty(self) -> bool:
        return not self._values

    def is_table(self, key: str) -> bool:
        return isinstance(self._values.get(key), dict)

    def table(self, key: str) -> "TomlTable":
        """The table [key]; empty if there is none."""
        values = self._checked(key, "a table", {}, lambda v: isinstance(v, dict))
        return TomlTable(values, self.file, self._lines, (*self._path, key))

    def tables(self, key: str) -> list["TomlTable"]:
        """The tables [[key]]; an empty list if there are none."""
        what = f"tables, each after a line [[{key}]]"
        values = self._checked(key, what, [], are_tables)
        path = (*self._path, key)
        return [TomlTable(v, self.file, self._lines, (*path, i)) for i, v in enumerate(values)]

    def _checked(self, key: str, what: str, default: Any, is_right: Any) -> Any:
        if key not in self._values:
            if default is _REQUIRED:
                close = difflib.get_close_matches(key, self._values, n=1)
                hint = f"; is {close[0]!r} meant to be it?" if close else ""
                raise self.error(f"{self.name} has no {key}: expected {what}{hint}", *close)
            return default
        value = self._values[key]
        if not is_right(value):
            raise self.error(f"{key} must be {what}, got {shown(value)}", key)
        return for_numpy(value)
