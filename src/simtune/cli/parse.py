"""Parses the command line; errors are one line each."""

import contextlib
import difflib
import io
import os
import re
from collections.abc import Sequence
from dataclasses import fields
from itertools import pairwise
from typing import Any, get_args

import tyro

from simtune.cli.commands import Command
from simtune.cli.completion import asks_for_completion, completion_mended
from simtune.cli.help import EXAMPLES, asks_for_help, with_help
from simtune.config.option_checks import flag
from simtune.errors import InputError, UnknownName

_TYPES = {"int": "a whole number", "float": "a number"}
_SHARED = ("--help", "--tyro-print-completion", "--tyro-write-completion")
_HELP = "; --help says what there is"


def parse(typed: Sequence[str]) -> Any:
    """The command with its options. Raises InputError instead of tyro's boxes of many lines."""
    typed = [_at_home(word) for word in typed]
    commands = {meta.name: c.__origin__ for c in get_args(Command) for meta in get_args(c)[1:]}
    if typed and not typed[0].startswith("-"):
        if typed[0] not in commands:
            raise UnknownName("command", typed[0], "simtune", commands)
        _check_options(typed[0], commands[typed[0]], typed[1:])
        _check_values(typed)
    stderr = io.StringIO()
    try:
        with contextlib.redirect_stderr(stderr), completion_mended(typed, commands):
            is_help = asks_for_help(typed)
            return tyro.cli(  # type: ignore[call-overload]
                with_help(commands, typed[0] not in commands) if is_help else Command,
                prog="simtune",
                description=EXAMPLES,
                args=typed,
                config=_markers(is_shown=is_help or asks_for_completion(typed)),
            )
    except SystemExit as exit_:
        if not exit_.code:
            raise
        raise InputError(_in_a_line(stderr.getvalue()) + _HELP) from None


def _markers(is_shown: bool) -> tuple[Any, ...]:
    """Tyro's configuration. --no-OPTION is understood, as sweeps type it, and not shown."""
    disallow_none = tyro.conf.DisallowNone  # an optional option is omitted, not set to None
    return (disallow_none, tyro.conf.FlagCreatePairsOff) if is_shown else (disallow_none,)


def _at_home(word: str) -> str:
    """With `~` as the home folder; bash expands it only where a word begins, not in --out=~/run."""
    option, equals, value = word.partition("=")
    if option.startswith("--") and equals:
        return f"{option}={os.path.expanduser(value)}"
    return os.path.expanduser(word)


def _check_options(command: str, kind: type, typed: Sequence[str]) -> None:
    """Raises InputError for an option that the command does not have."""
    options = [flag(field.name) for field in fields(kind)]
    known = [*options, *_SHARED, *(f"--no-{option[2:]}" for option in options)]
    for word in typed:
        name = word.partition("=")[0].replace("_", "-")
        if name.startswith("--") and name not in known:
            close = difflib.get_close_matches(name, options, n=1)
            hint = f"; did you mean {close[0]}?" if close else _HELP
            raise InputError(f"simtune {command} has no {name}{hint}")


def _check_values(typed: Sequence[str]) -> None:
    """Raises InputError for an empty value: as a path it would be the current folder."""
    for before, word in pairwise(typed):
        option = re.fullmatch(r"(--[\w-]+)=", word)
        if option or not word:
            name = option[1] if option else before
            named = name if name.startswith("--") else f"simtune {typed[0]}"
            raise InputError(f"{named} needs a value, got ''{_HELP}")


def _in_a_line(output: str) -> str:
    """Tyro's message, which is in a box or, without UTF-8, beneath a title, in one line."""
    lines = [line.strip("│| ") for line in output.splitlines()]
    text = "\n".join(line for line in lines if line[:1] not in ("╭", "╰"))
    parts = re.split(r"^[-─]{5,}$", text, flags=re.MULTILINE)
    part = parts[0] if "╭" in output or len(parts) < 2 else parts[1]
    message = re.sub(r", 'None'|'None', ", "", " ".join(part.split()).rstrip("."))
    if wrong := re.search(r"Error parsing (\S+): .*\b(int|float)\b.*: ('.*')", message):
        option, kind, value = wrong.groups()
        return f"{option} must be {_TYPES[kind]}, got {value}"
    if missing := re.match(r"Missing from (simtune \w+): (--\S+ \S+|\S+) ", message):
        return "{} needs {}".format(*missing.groups())
    if alone := re.match(r"Missing value for argument '(\S+)'", message):
        return f"{alone[1]} needs a value"
    return message
