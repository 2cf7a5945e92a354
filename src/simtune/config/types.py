"""Checks of options' types, for options that no command line has parsed: Python's and a grid's."""

from collections.abc import Mapping
from dataclasses import fields
from numbers import Integral, Real
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from simtune.config.option_checks import flag
from simtune.errors import InputError

_WORDS = {bool: "true or false", int: "a whole number", float: "a number", Path: "a path"}


def check_types(config: type, values: Mapping[str, Any]) -> None:
    """Raises InputError for a value that an option of a dataclass of options does not admit.

    A path may be text, and no text is empty. Names that are no options are ignored.
    """
    hints = get_type_hints(config)
    for option in fields(config):
        name = option.name
        if name in values and not _fits(values[name], hints[name]):
            example = f" such as {option.default!r}" if isinstance(option.default, str) else ""
            expected = _expected(hints[name], example)
            raise InputError(f"{flag(name)} must be {expected}, got {values[name]!r}")


def _fits(value: Any, hint: Any) -> bool:
    if get_origin(hint) in (Union, UnionType):
        return any(_fits(value, member) for member in get_args(hint))
    if get_origin(hint) is Literal:
        return isinstance(value, str) and value in get_args(hint)
    if isinstance(value, bool):
        return hint is bool
    if isinstance(value, str) and not value:  # as a path it would be the current folder
        return False
    return isinstance(value, {float: Real, int: Integral, Path: str | Path}.get(hint, hint))


def _expected(hint: Any, example: str) -> str:
    """What an option admits, in words."""
    if get_origin(hint) in (Union, UnionType):
        members = [member for member in get_args(hint) if member is not type(None)]
        return " or ".join(_expected(member, example) for member in members)
    if get_origin(hint) is Literal:
        *others, last = get_args(hint)
        return f"{', '.join(others)} or {last}"
    return _WORDS.get(hint, f"text{example}")
